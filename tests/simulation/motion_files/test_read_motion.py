"""What a motion file leaves open, told by the file: what positions mean, who is who, the unit, which way is up."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model
from handtrack.simulation.motion_files.bvh import read_bvh
from handtrack.simulation.motion_files.clip import BANDAI_JOINTS, CMU_JOINTS, MotionClip
from handtrack.simulation.motion_files.joint_tables import (
    TABLES,
    matched_joints,
    own_table,
    read_table,
)
from handtrack.simulation.motion_files.read_motion import (
    RawMotion,
    axis_words,
    in_metres,
    read_motion,
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
def test_what_positions_mean_is_seen(case: str, tmp_path: Path) -> None:
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


def test_what_positions_mean_is_asked_where_the_file_does_not_show_it(tmp_path: Path) -> None:
    path = bvh(tmp_path, [(3, 9, 0, 2, 1, 0), (0, 4, 5, 8, 6, 2)])
    with pytest.raises(HandtrackError, match="--positions add or --positions replace"):
        read_bvh(path)


@pytest.mark.parametrize("table", TABLES)
def test_names_in_use_are_known(table: str) -> None:
    rows = TABLES[table]
    prefix = "mixamorig:" if table == "mixamo" else ""
    found = matched_joints(BODY, [prefix + name for name in rows.values()], "it")
    assert {ours: name.removeprefix(prefix) for ours, name in found.names.items()} == rows


def test_names_of_our_own_export_and_of_detectors() -> None:
    assert matched_joints(BODY, list(own_table(BODY).values()), "it").table == "handtrack"
    hand = load_model("hand26")
    assert len(matched_joints(hand, list(own_table(hand).values()), "it").names) == 21
    found = matched_joints(
        BODY, ["LShoulder", "RShoulder", "LHip", "RHip", "LKnee", "RKnee", "LBigToe"], "it"
    )
    assert found.names["left_toe"] == "LBigToe"
    assert len(BANDAI_JOINTS) == len(CMU_JOINTS) == 17


def test_unknown_names_are_listed_with_what_they_could_be(tmp_path: Path) -> None:
    odd = ["bone_a", "LeftUpLegs", "tail"]
    with pytest.raises(
        HandtrackError, match=r"bone_a, LeftUpLegs \(left_hip\?\), tail. Write a table"
    ):
        matched_joints(BODY, odd, "it")
    path = tmp_path / "t.toml"
    path.write_text("".join(f'{ours} = "b{i}"\n' for i, ours in enumerate(BODY.joint_names[:8])))
    known = [f"b{i}" for i in range(9)]
    found = read_table(path, BODY, known)
    assert (found.names["head"], found.unused) == ("b3", ("b8",))
    path.write_text('left_kneee = "b1"\n')
    with pytest.raises(
        HandtrackError, match="no joint of body34 'left_kneee'.*Did you mean 'left_knee'"
    ):
        read_table(path, BODY, known)
    path.write_text('left_knee = "b99"\n')
    with pytest.raises(HandtrackError, match="no joint 'b99' in the motion file"):
        read_table(path, BODY, known)


@pytest.mark.parametrize("unit", ["metres", "centimetres", "millimetres", "inches"])
def test_the_unit_is_told_by_a_person_s_size(unit: str) -> None:
    unit_m = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254}[unit]
    same = {name: name for name in names()}
    for scale in (0.8, 1.0, 1.2):  # statures of 1.4 to 2.1 m
        raw = RawMotion("made", MotionClip(names(), scale * places() / unit_m, 25.0), None)
        clip, found, (said,) = in_metres(raw, same, "body", None, "it")
        assert found == unit_m
        assert said.startswith(f"unit: {unit};")
        np.testing.assert_allclose(clip.positions, scale * places())


def test_a_unit_that_is_nobody_s_is_asked_about() -> None:
    same = {name: name for name in names()}
    raw = RawMotion("made", MotionClip(names(), 17.7 * places(), 25.0), None)
    with pytest.raises(HandtrackError, match=r"--unit-m \(0.056. would make an adult\)"):
        in_metres(raw, same, "body", None, "it")
    assert in_metres(raw, same, "body", 1 / 17.7, "it")[0].positions == pytest.approx(places())
    trunk = {name: name for name in names() if "knee" not in name}
    with pytest.raises(HandtrackError, match="The joints that would tell it are missing"):
        in_metres(raw, trunk, "body", None, "it")
    (note,) = in_metres(raw, same, "body", 1.0, "it")[2]
    assert "expected 58 to 172 cm" in note


@pytest.mark.parametrize(
    ("axis", "sign", "words"), [(1, 1, "+y"), (2, 1, "+z"), (2, -1, "−z"), (0, 1, "+x")]
)
def test_up_is_where_the_shoulders_are(axis: int, sign: int, words: str) -> None:
    turned = np.roll(places(), axis - 1, axis=2) * sign
    found = upright_axis(MotionClip(names(), turned, 25.0))
    assert found is not None
    assert axis_words(found) == words
    back = turned_upright(turned, found)
    rise = back[:, names().index("left_shoulder"), 1] - back[:, names().index("left_hip"), 1]
    assert (rise > 0.2).all()
    size = np.linalg.norm(places()[:, 3] - places()[:, 12], axis=1)
    np.testing.assert_allclose(np.linalg.norm(back[:, 3] - back[:, 12], axis=1), size)


def test_an_amc_without_a_skeleton_or_rate(tmp_path: Path) -> None:
    path = tmp_path / "01_01.amc"
    path.write_text(":DEGREES\n1\nroot 0 1 0 0 0 0\n")
    with pytest.raises(
        HandtrackError, match=re.escape("none lies beside it; give it with --skeleton")
    ):
        read_motion(path)
    (tmp_path / "01.asf").write_text(
        ":units\n  length 1.0\n  angle deg\n:bonedata\n  begin\n    name leg\n    direction 0 -1 0\n    length 2\n"
        "    axis 0 0 0 XYZ\n  end\n:hierarchy\n  begin\n    root leg\n  end\n"
    )
    raw = read_motion(path)
    assert (raw.clip.fps, raw.unit_m, raw.clip.names) == (120.0, 1.0, ("root", "leg"))
    assert "120 frames a second" in raw.notes[0]
    assert read_motion(path, fps=60.0).notes == ()
    with pytest.raises(HandtrackError, match="is a skeleton alone"):
        read_motion(tmp_path / "01.asf")
