"""A session whose masks start from its joints; files of masks that say where nobody knows."""

from functools import cache

import cv2
import numpy as np
import pytest

from handtrack import Session
from handtrack.capture.images.openpose import LAYOUTS, write_points
from handtrack.session.doctor.check_views import check_view
from tests.capture.seeded_scenes import SIZE, recording
from tests.conftest import refused

SETTINGS = """
[session]
format = 1
fps = 10.0

[[camera]]
name = "cam0"
images = "cam0/*.png"
masks = {masks}
"""
JOINTS = 'keypoints = "joints/*.json"\nkeypoint_layout = "mediapipe21"\n'
CALIBRATION = f"""
[cam_0]
name = "cam0"
size = [{SIZE[0]}, {SIZE[1]}]
matrix = [[420.0, 0.0, 180.0], [0.0, 420.0, 150.0], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0, 0.0]
rotation = [0.0, 0.0, 0.0]
translation = [0.0, -0.08, 0.55]
"""
NOBODY = (3, *range(8, 15))


drawn = cache(lambda: recording("even", np.random.default_rng(7), 16))


def images_in(folder, drawn):
    """Write the images of a camera, and its calibration."""
    (folder / "cam0").mkdir()
    for frame, image in enumerate(drawn.images):
        cv2.imwrite(str(folder / "cam0" / f"{frame:03d}.png"), image)
    (folder / "calibration.toml").write_text(CALIBRATION)


@pytest.fixture
def folder(tmp_path):
    images_in(tmp_path, drawn())
    (tmp_path / "joints").mkdir()
    for frame in drawn().frames:
        points = np.array([[*at, 0.9] for at in drawn().joints[frame].values()])
        hand = None if frame in NOBODY else points
        write_points(tmp_path / "joints" / f"{frame:03d}.json", hand, LAYOUTS["hand_right"], "test")
    return tmp_path


def opened(folder, masks, more=""):
    (folder / "session.toml").write_text(SETTINGS.format(masks=masks) + more)
    return Session.open(folder)


def test_masks_start_from_joints_and_an_observation_that_is_kept_has_all_of_them(folder):
    session = opened(folder, '{ method = "seeded" }', JOINTS)
    made = session.view("cam0").silhouette(2)
    for _ in range(2):
        (kept,) = session.observation(2).silhouettes
        np.testing.assert_array_equal(kept.mask, made.mask)
        np.testing.assert_array_equal(kept.valid, made.valid)
        kept.mask[:] = 0  # memory of its own
    assert {-1.0, 0.0, 1.0} == set(np.unique(made.mask).tolist())
    assert (made.mask == 1).sum() > 2000
    found = check_view(session.view("cam0"), session)
    assert not [finding for finding in found if finding.severity == "error"]


def test_files_of_masks_may_say_that_nobody_knows(folder):
    (folder / "masks").mkdir()
    mask = np.zeros(SIZE[::-1], np.uint8)
    mask[100:200, 100:200], mask[150:160, 200:250] = 255, 90
    cv2.imwrite(str(folder / "masks" / "000.png"), mask)
    (seen,) = opened(folder, '"masks/*.png"', "mask_unknown = 90\n").observation(0).silhouettes
    assert (seen.mask == -1).sum() == 500
    (plain,) = opened(folder, '"masks/*.png"').observation(0).silhouettes
    assert plain.mask.min() == 0
    refused("mask_unknown", opened, folder, '{ method = "skin_ycrcb" }', "mask_unknown = 90\n")
