"""`handtrack new` with fisheye lenses: images, masks and joints as pinhole views show them."""

import cv2
import numpy as np

from handtrack import Session
from tests.capture.calibration_forms.test_calibration_forms import fisheyes
from tests.capture.sample_files import sample

SPOTS = np.array([[0.0, 0.0, 0.5], [0.12, 0.05, 0.5], [-0.2, 0.1, 0.6], [0.05, -0.15, 0.45]])


def taken(table, places):
    """Return the pixels (N, 2) at which a fisheye shows points of the world."""
    turned = places @ np.array(table["rotation"]).T + np.array(table["translation"])
    lens = np.array(table["matrix"]), np.array(table["distortions"])
    return cv2.fisheye.projectPoints(turned[:, None], np.zeros(3), np.zeros(3), *lens)[0][:, 0]


def test_images_and_joints_of_fisheyes_are_where_the_session_s_cameras_show_them(
    handtrack, tmp_path
):
    tables, (rig,) = fisheyes(), sample("calibration/fisheye_json", tmp_path)
    options = []
    for name, table in tables.items():
        (tmp_path / name).mkdir()
        pixels = taken(table, SPOTS)
        rows, columns = np.mgrid[:480, :640]
        image = np.sum(
            [120 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / 18) for u, v in pixels], axis=0
        )
        cv2.imwrite(
            str(tmp_path / name / "000.png"), np.repeat(image[..., None], 3, 2).astype(np.uint8)
        )
        options += ["--images", f"{name}={tmp_path / name}/*.png"]
    handtrack.does(
        "new", "--out", tmp_path / "s", *options, "--fps", 30, "--calibration", rig, "--masks", "none"
    )  # fmt: skip
    session = Session.open(tmp_path / "s")
    shown = set()
    for view in session.views:
        image = view.image(0)
        assert image.shape[:2] == view.camera.size[::-1]
        for i, spot in enumerate(SPOTS):
            u, v = view.camera.project(spot)
            if not (12 < u < view.camera.size[0] - 12 and 12 < v < view.camera.size[1] - 12):
                continue
            patch = image[round(v) - 9 : round(v) + 10, round(u) - 9 : round(u) + 10, 0].astype(
                float
            )
            rows, columns = np.mgrid[-9:10, -9:10]
            middle = np.array([(patch * columns).sum(), (patch * rows).sum()]) / patch.sum()
            assert np.abs(middle + [round(u) - u, round(v) - v]).max() < 0.4
            shown.add(i)
    assert len(shown) == len(SPOTS)
