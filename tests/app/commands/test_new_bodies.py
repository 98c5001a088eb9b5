"""`handtrack new` with 2D joints of bodies."""

import cv2
import numpy as np
import pytest

from handtrack import Session
from handtrack.capture.calibration.rig_file import write_rig
from tests.capture.joints.people import FRAMES, in_order, openpose, pixels, rig


@pytest.fixture
def words(tmp_path):
    """Two cameras, each with a person's joints and a smaller one's behind."""
    write_rig(tmp_path / "rig.toml", rig())
    said: list[object] = ["new", "--out", tmp_path / "made"]
    said += ["--calibration", tmp_path / "rig.toml", "--fps", 25]
    for i, camera in enumerate(rig()):
        seen = {f: in_order("body_25b", p) for f, p in enumerate(pixels(i))}
        people = {f: [p * (0.4, 0.4, 1.0), p] for f, p in seen.items() if f != 3 or i}
        said += ["--keypoints", f"{camera.name}={openpose(tmp_path / camera.name, people)}"]
    return said


def test_a_body_by_joints_alone(handtrack, words, tmp_path):
    ended = handtrack.does(*words)
    assert "--person" in ended.err, "others are there"
    session = Session.open(tmp_path / "made")
    file = session.file
    assert (file.hand.model, file.hand.scale, session.frame_count) == ("body34", "fit", FRAMES)
    assert [(c.keypoint_layout, c.masks) for c in file.cameras] == [("body_25b", None)] * 2
    assert file.tracking["silhouettes"]["bands_mm"] == [60.0, 30.0, 10.0]
    focal_px, distance_m = 608.0, 3.5
    expected = 0.025 * focal_px / distance_m
    assert file.tracking["keypoints"]["sigma_px"] == pytest.approx(expected, rel=0.1)
    seen = session.view("cam0").keypoints(5, 1.0)[0]
    nose = pixels()[5][4]
    assert seen.pixels[seen.names.index("nose")] == pytest.approx(nose, abs=0.01)
    assert not session.view("cam0").keypoints(3, 1.0)


def test_a_codec_s_padding_is_no_other_size(handtrack, words, tmp_path):
    """Calibrated for 640 × 480, recorded as 632 × 480: eight columns are filling. 624 columns are another image."""
    for width, code in ((632, 0), (624, 2)):
        folder = tmp_path / str(width)
        folder.mkdir()
        cv2.imwrite(str(folder / "0.png"), np.zeros((480, width, 3), np.uint8))
        said = [*words, "--images", f"cam0={folder}"]
        said[2] = tmp_path / f"made{width}"
        ended = handtrack(*said)
        assert ended.code == code, ended.err
    session = Session.open(tmp_path / "made632")
    assert session.rig["cam0"].size == (632, 480)
    np.testing.assert_array_equal(session.rig["cam0"].matrix, rig()["cam0"].matrix)
