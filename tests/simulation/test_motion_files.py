"""Motion files: BVH, ASF with AMC, and what positions mean."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import load_model
from handtrack.simulation.motion_files.clip import INCH_M, MotionClip, read_asf_amc, read_bvh
from handtrack.simulation.motion_files.read_motion import (
    TABLES,
    in_metres,
    matched_joints,
    turned_upright,
    upright_axis,
)
from tests.capture.joints.people import names, places
from tests.conftest import refused

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
    assert_allclose(at[0], [[1, 2, 3], [1, -2, 3], [1, -5, 3]], atol=1e-12)
    # the shin bends by Rx(90°): −y to −z; the root's Ry(90°) turns that to −x
    assert_allclose(at[1], [[0, 0, 0], [0, -4, 0], [-3, -4, 0]], atol=1e-12)
    # the thigh's axes are turned by 90° about z: its rx is a turn about y, which leaves −y alone
    assert_allclose(at[2], [[0, 0, 0], [0, -4, 0], [0, -7, 0]], atol=1e-12)
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
    refused(message, read, tmp_path, skeleton=SKELETON.replace(old, new, 1))


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
    assert_allclose(clip.positions[0], [[0, 0.9, 0], [0, 0.5, 0], [0, 0.2, 0]], atol=1e-12)
    # Rz(90°) turns −y to +x; then Rx(90°) about the carried axis turns the end to −z.
    assert_allclose(clip.positions[1], [[0.1, 0.9, 0], [0.5, 0.9, 0], [0.5, 0.9, -0.3]], atol=1e-12)


def test_the_order_of_rotations_is_that_of_the_channels(tmp_path):
    swapped = HEADER.replace(
        "3 Zrotation Xrotation Yrotation", "3 Xrotation Zrotation Yrotation", 1
    )
    one = "MOTION\nFrames: 1\nFrame Time: 0.05\n0 0 0 0 0 0 90 90 0\n"
    first = read_bvh(written(tmp_path, HEADER + one)).positions[0, 2]
    second = read_bvh(written(tmp_path, swapped + one)).positions[0, 2]
    assert_allclose(first, [0, -0.4, -0.3], atol=1e-12)
    assert_allclose(second, [0.3, -0.4, 0], atol=1e-12)


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
    refused(message, read_bvh, written(tmp_path, (HEADER + FRAMES).replace(old, new, 1)))


BODY = load_model("body34")
SIX = "6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
POINTS = f"""HIERARCHY
ROOT Hips
{{
  OFFSET 0 0 0
  CHANNELS {SIX}
  JOINT Spine
  {{
    OFFSET 0 20 0
    CHANNELS {SIX}
    JOINT Head
    {{
      OFFSET 0 30 0
      CHANNELS {SIX}
    }}
  }}
}}
"""
MEANT = {
    "each frame repeats the offsets": ("replace", [(0, 20, 0, 0, 30, 0), (0, 20, 0, 0, 30, 0)]),
    "the hips below the root walk": ("replace", [(0, 25, 0, 0, 30, 0), (9, 20, 7, 0, 30, 0)]),
    "nothing but rotations": ("add", [(0, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 0)]),
    "a bone swings by its position": ("replace", [(0, 20, 0, 30, 0, 0), (20, 0, 0, 0, 30, 0)]),
    "a bone swings about its offset": ("add", [(20, -20, 0, 30, -30, 0), (0, 0, 0, 0, 0, 0)]),
}  # fmt: skip


def bvh(folder, moves):
    rows = [
        f"0 90 0 0 0 0 {' '.join(map(str, m[:3]))} 0 0 0 {' '.join(map(str, m[3:]))} 0 0 0"
        for m in moves
    ]
    text = POINTS + "MOTION\nFrames: 2\nFrame Time: 0.04\n" + "\n".join(rows) + "\n"
    return written(folder, text)


@pytest.mark.parametrize("case", MEANT)
def test_what_positions_mean_is_seen(case, tmp_path):
    expected, moves = MEANT[case]
    path = bvh(tmp_path, moves)
    found = read_bvh(path).positions
    assert_allclose(found, read_bvh(path, expected).positions)
    assert (
        np.abs(
            found - read_bvh(path, {"add": "replace", "replace": "add"}[expected]).positions
        ).max()
        > 0.1
    )


@pytest.mark.parametrize("table", TABLES)
def test_names_in_use_are_known(table):
    rows = TABLES[table]
    prefix = "mixamorig:" if table == "mixamo" else ""
    found, _ = matched_joints(BODY, [prefix + name for name in rows.values()], "it")
    assert {ours: name.removeprefix(prefix) for ours, name in found.items()} == rows


@pytest.mark.parametrize("unit_m", [1.0, 0.01, 0.001, 0.0254])
def test_the_unit_is_told_by_a_person_s_size(unit_m):
    same = {name: name for name in names()}
    for scale in (0.8, 1.0, 1.2):  # statures of 1.4 to 2.1 m
        raw = MotionClip(names(), scale * places() / unit_m, 25.0)
        clip, found, _ = in_metres(raw, same, "body", None, "it")
        assert found == unit_m
        assert_allclose(clip.positions, scale * places())


@pytest.mark.parametrize(("axis", "sign"), [(1, 1), (2, 1), (2, -1), (0, 1)])
def test_up_is_where_the_shoulders_are(axis, sign):
    turned = np.roll(places(), axis - 1, axis=2) * sign
    found = upright_axis(MotionClip(names(), turned, 25.0))
    assert found is not None
    back = turned_upright(turned, found)
    rise = back[:, names().index("left_shoulder"), 1] - back[:, names().index("left_hip"), 1]
    assert (rise > 0.2).all()
    size = np.linalg.norm(places()[:, 3] - places()[:, 12], axis=1)
    assert_allclose(np.linalg.norm(back[:, 3] - back[:, 12], axis=1), size)
