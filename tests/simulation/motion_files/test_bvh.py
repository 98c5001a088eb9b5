"""BVH on a tiny file worked out by hand, and on the dance."""

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.simulation.motion_files.bvh import read_bvh

HEADER = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Knee
  {
    OFFSET 0 -40 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 -30 0
    }
  }
}
"""
FRAMES = """MOTION
Frames: 2
Frame Time: 0.05
0 90 0 0 0 0 0 0 0
10 90 0 90 0 0 0 90 0
"""


def written(tmp_path, text):
    path = tmp_path / "tiny.bvh"
    path.write_text(text)
    return path


def test_turns_carry_the_joints_after_them(tmp_path):
    clip = read_bvh(written(tmp_path, HEADER + FRAMES))
    assert clip.names == ("Hips", "Knee", "Knee_end")
    assert clip.fps == pytest.approx(20.0)
    np.testing.assert_allclose(
        clip.positions[0], [[0, 0.9, 0], [0, 0.5, 0], [0, 0.2, 0]], atol=1e-12
    )
    # Rz(90°) turns −y to +x; then Rx(90°) about the carried axis turns the end to −z.
    np.testing.assert_allclose(
        clip.positions[1], [[0.1, 0.9, 0], [0.5, 0.9, 0], [0.5, 0.9, -0.3]], atol=1e-12
    )


def test_the_order_of_rotations_is_that_of_the_channels(tmp_path):
    swapped = HEADER.replace(
        "3 Zrotation Xrotation Yrotation", "3 Xrotation Zrotation Yrotation", 1
    )
    one = "MOTION\nFrames: 1\nFrame Time: 0.05\n0 0 0 0 0 0 90 90 0\n"
    first = read_bvh(written(tmp_path, HEADER + one)).positions[0, 2]
    second = read_bvh(written(tmp_path, swapped + one)).positions[0, 2]
    np.testing.assert_allclose(first, [0, -0.4, -0.3], atol=1e-12)
    np.testing.assert_allclose(second, [0.3, -0.4, 0], atol=1e-12)


def test_positions_of_a_joint_add_to_its_offset_or_replace_it(tmp_path):
    text = HEADER.replace(
        "3 Zrotation Xrotation Yrotation",
        "6 Xposition Yposition Zposition Zrotation Xrotation Yrotation",
        1,
    )
    text += "MOTION\nFrames: 1\nFrame Time: 0.05\n0 0 0 0 0 0 1 -38 2 0 0 0\n"
    path = written(tmp_path, text)
    np.testing.assert_allclose(read_bvh(path, "add").positions[0, 1], [0.01, -0.78, 0.02])
    np.testing.assert_allclose(read_bvh(path, "replace").positions[0, 1], [0.01, -0.38, 0.02])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Frames: 2", "Frames: 3", "'Frames: 3', but 2 frames follow"),
        ("10 90 0 90 0 0 0 90 0", "10 90 0 90", r"line 20: expected 9 numbers; found '10 90 0 90'"),
        ("0.05", "0", "Frame Time 0; expected seconds above 0"),
        ("OFFSET 0 -40 0", "OFFSET 0 -40", r"line 8: expected 3 numbers"),
        ("3 Zrotation", "2 Zrotation", r"line 9: expected CHANNELS, their number"),
        ("MOTION", "", r"line 17: expected ROOT"),
    ],
)
def test_broken_files_are_named_with_their_line(tmp_path, old, new, message):
    with pytest.raises(HandtrackError, match=message):
        read_bvh(written(tmp_path, (HEADER + FRAMES).replace(old, new, 1)))
