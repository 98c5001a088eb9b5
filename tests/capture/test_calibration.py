"""Calibration files: read, written, refused."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import HandtrackError
from handtrack.capture.calibration.rig_file import read_rig

GOOD = """
[cam_0]
name = "cam0"
size = [640, 480]
matrix = [[600.0, 0.0, 320.0], [0.0, 601.0, 240.0], [0.0, 0.0, 1.0]]
distortions = [0.1, -0.2, 0.001, 0.002, 0.0]
rotation = [0.1, 0.2, 0.3]
translation = [10.0, 20.0, 700.0]
fisheye = false

[metadata]
adjusted = true
error = 0.3
"""


def write(path, text):
    path.write_text(text)
    return path


def test_reads_aniposes_form_in_metres(tmp_path):
    rig = read_rig(write(tmp_path / "c.toml", GOOD), world_unit_m=0.001)
    camera = rig["cam0"]
    assert rig.names == ("cam0",)
    assert read_rig(write(tmp_path / "c.toml", GOOD.replace("= false", '= "False"'))).names
    assert camera.size == (640, 480)
    assert_allclose(camera.translation, [0.01, 0.02, 0.7])
    assert_allclose(camera.rotation, cv2.Rodrigues(np.array([0.1, 0.2, 0.3]))[0])
    assert_allclose(camera.distortions, [0.1, -0.2, 0.001, 0.002, 0.0])


NO_RIGHT = "rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]"
BAD = {
    "fisheye": ("fisheye = false", "fisheye = true", r"\[cam_0\]: fisheye = true; .*not supported"),
    "coefficients": ("0.002, 0.0]", "0.002]", None),
    "missing": (
        "size = [640, 480]",
        "",
        r"\[cam_0\]: the key 'size' is missing; a camera needs name",
    ),
    "NaN": ("[10.0, 20.0", "[nan, 20.0", r"translation: \[nan, 20.0, 700.0\]; expected finite"),
    "a matrix": (
        "rotation = [0.1, 0.2, 0.3]",
        NO_RIGHT,
        "rotation: 9 numbers; expected 3, a rotation vector",
    ),
    "text": ("[0.1, 0.2, 0.3]", '["a", 0, 0]', r"rotation: \['a', 0, 0\]; expected numbers"),
    "size": (
        "[640, 480]",
        "[640.5, 480]",
        r"size: \[640.5, 480.0\]; expected width and height in whole",
    ),
    "name": ('"cam0"', "7", "name = 7; expected a text"),
    "syntax": ("size = [640", "size = 640", r"c.toml: not valid TOML: .*\(at line 4"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_calibrations_are_refused(case, tmp_path):
    old, new, message = BAD[case]
    assert old in GOOD
    path = write(tmp_path / "c.toml", GOOD.replace(old, new))
    if message is None:
        assert len(read_rig(path)["cam0"].distortions) == 4
        return
    with pytest.raises(HandtrackError, match=message) as caught:
        read_rig(path)
    assert str(path) in str(caught.value)
