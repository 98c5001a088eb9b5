"""What a motion file leaves open, told by the file: what positions mean, who is who, the unit, which way is up."""

from pathlib import Path

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.simulation.motion_files.bvh import read_bvh
from handtrack.simulation.motion_files.clip import MotionClip
from handtrack.simulation.motion_files.joint_tables import (
    TABLES,
    matched_joints,
)
from handtrack.simulation.motion_files.read_motion import (
    RawMotion,
    axis_words,
    in_metres,
    turned_upright,
    upright_axis,
)
from tests.capture.joints.people import names, places

BODY = load_model("body34")
SIX = "6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
SKELETON = f"""HIERARCHY
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


def bvh(folder: Path, moves: list[tuple[float, ...]]) -> Path:
    rows = [
        f"0 90 0 0 0 0 {' '.join(map(str, m[:3]))} 0 0 0 {' '.join(map(str, m[3:]))} 0 0 0"
        for m in moves
    ]
    path = folder / "a.bvh"
    path.write_text(SKELETON + "MOTION\nFrames: 2\nFrame Time: 0.04\n" + "\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("case", MEANT)
def test_what_positions_mean_is_seen(case, tmp_path):
    expected, moves = MEANT[case]
    path = bvh(tmp_path, moves)
    found = read_bvh(path).positions
    np.testing.assert_allclose(found, read_bvh(path, expected).positions)
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
    found = matched_joints(BODY, [prefix + name for name in rows.values()], "it")
    assert {ours: name.removeprefix(prefix) for ours, name in found.names.items()} == rows


@pytest.mark.parametrize("unit", ["metres", "centimetres", "millimetres", "inches"])
def test_the_unit_is_told_by_a_person_s_size(unit):
    unit_m = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254}[unit]
    same = {name: name for name in names()}
    for scale in (0.8, 1.0, 1.2):  # statures of 1.4 to 2.1 m
        raw = RawMotion("made", MotionClip(names(), scale * places() / unit_m, 25.0), None)
        clip, found, (said,) = in_metres(raw, same, "body", None, "it")
        assert found == unit_m
        assert said.startswith(f"unit: {unit};")
        np.testing.assert_allclose(clip.positions, scale * places())


@pytest.mark.parametrize(
    ("axis", "sign", "words"), [(1, 1, "+y"), (2, 1, "+z"), (2, -1, "−z"), (0, 1, "+x")]
)
def test_up_is_where_the_shoulders_are(axis, sign, words):
    turned = np.roll(places(), axis - 1, axis=2) * sign
    found = upright_axis(MotionClip(names(), turned, 25.0))
    assert found is not None
    assert axis_words(found) == words
    back = turned_upright(turned, found)
    rise = back[:, names().index("left_shoulder"), 1] - back[:, names().index("left_hip"), 1]
    assert (rise > 0.2).all()
    size = np.linalg.norm(places()[:, 3] - places()[:, 12], axis=1)
    np.testing.assert_allclose(np.linalg.norm(back[:, 3] - back[:, 12], axis=1), size)
