"""ASF/AMC on a tiny skeleton worked out by hand, and on the walk."""

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.simulation.motion_files.asf_amc import INCH_M, read_asf_amc

SKELETON = """# two bones, one below the other
:version 1.10
:name TINY
:units
  mass 1.0
  length 0.5
  angle deg
:root
   order TX TY TZ RX RY RZ
   axis XYZ
:bonedata
  begin
     id 1
     name thigh
     direction 0 -1 0
     length 4
     axis 0 0 90 XYZ
    dof rx rz
    limits (-160.0 20.0)
           (-70.0 70.0)
  end
  begin
     id 2
     name shin
     direction 0 -1 0
     length 3
     axis 0 0 0 XYZ
    dof rx
  end
:hierarchy
  begin
    root thigh
    thigh shin
  end
"""
MOTION = """#!OML
:FULLY-SPECIFIED
:DEGREES
1
root 1 2 3 0 0 0
thigh 0 0
shin 0
2
root 0 0 0 0 90 0
thigh 0 0
shin 90
3
root 0 0 0 0 0 0
thigh 90 0
shin 0
"""


def read(tmp_path, skeleton=SKELETON, motion=MOTION):
    (tmp_path / "a.asf").write_text(skeleton)
    (tmp_path / "a.amc").write_text(motion)
    return read_asf_amc(tmp_path / "a.asf", tmp_path / "a.amc")


def test_turns_are_about_the_bones_own_axes(tmp_path):
    clip = read(tmp_path)
    assert clip.names == ("root", "thigh", "shin")
    at = clip.positions / (INCH_M / 0.5)
    np.testing.assert_allclose(at[0], [[1, 2, 3], [1, -2, 3], [1, -5, 3]], atol=1e-12)
    # the shin bends by Rx(90°): −y to −z; the root's Ry(90°) turns that to −x
    np.testing.assert_allclose(at[1], [[0, 0, 0], [0, -4, 0], [-3, -4, 0]], atol=1e-12)
    # the thigh's axes are turned by 90° about z: its rx is a turn about y, which leaves −y alone
    np.testing.assert_allclose(at[2], [[0, 0, 0], [0, -4, 0], [0, -7, 0]], atol=1e-12)
    assert clip.fps == 120.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("direction 0 -1 0", "direction 0 x 0", r"a.asf, line 15: cannot be understood"),
        ("angle deg", "angle rad", "angles in degrees are expected"),
        ("    thigh shin\n", "", "without a place in :hierarchy: shin"),
        ("0 0 90 XYZ", "0 0 90 ZYX", "order XYZ"),
    ],
)
def test_broken_skeletons_are_named(tmp_path, old, new, message):
    with pytest.raises(HandtrackError, match=message):
        read(tmp_path, skeleton=SKELETON.replace(old, new, 1))
