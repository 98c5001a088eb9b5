"""init.json: both forms read and written, everything else refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.model.articulated import HandScale
from handtrack.session.first_pose.first_pose import FirstPose, read_first_pose, write_first_pose
from tests.session.small_session import keypoints, write_init

XYZ: list[Any] = keypoints().tolist()
NAMES = ("root_tx", "index_mcp_flex")


def test_keypoints_with_unknown_rows(tmp_path: Path) -> None:
    write_init(tmp_path, frame=18, xyz=[None, [None, None, None], *XYZ[2:]])
    pose = read_first_pose(tmp_path / "init.json")
    assert pose.frame == 18
    assert pose.parameters == {}
    assert pose.xyz is not None
    assert np.isnan(pose.xyz[:2]).all()
    np.testing.assert_array_equal(pose.xyz[2:], keypoints()[2:])


def test_parameters_by_name(tmp_path: Path) -> None:
    write_init(tmp_path, xyz=None, parameters={"root_tx": 0.1, "index_mcp_flex": 1})
    pose = read_first_pose(tmp_path / "init.json", NAMES)
    assert pose.parameters == {"root_tx": 0.1, "index_mcp_flex": 1.0}
    assert pose.xyz is None


def test_what_is_written_reads_back(tmp_path: Path) -> None:
    xyz = keypoints()
    xyz[4] = np.nan
    small = HandScale(0.8, {"thumb": 1.05})
    poses = [
        FirstPose(3, {}, xyz, "openpose21"),
        FirstPose(2, {"root_tx": 0.1}),
        FirstPose(2, {"root_tx": 0.1}, scale=small),
    ]
    for pose in poses:
        write_first_pose(tmp_path / "i.json", pose)
        again = read_first_pose(tmp_path / "i.json")
        assert (again.frame, dict(again.parameters)) == (pose.frame, dict(pose.parameters))
        assert again.scale == pose.scale
        if pose.xyz is not None:
            assert again.xyz is not None
            np.testing.assert_array_equal(again.xyz, pose.xyz)


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "rows": (
        {"xyz": XYZ[:20]},
        r"xyz has 20 rows; expected 21 rows \[x, y, z\], null where unknown",
    ),
    "no rows": ({"xyz": 3}, "xyz has int; expected 21 rows"),
    "numbers in a row": (
        {"xyz": [*XYZ[:20], [1, 2, 3, 4]]},
        r"row 20 of xyz is \[1, 2, 3, 4\]; exp",
    ),
    "half a row": (
        {"xyz": [[0.1, None, 0.2], *XYZ[1:]]},
        "row 0 of xyz is .*; expected .x, y, z. or",
    ),
    "text in a row": ({"xyz": [["a", 0, 0], *XYZ[1:]]}, "row 0 of xyz is .'a', 0, 0.; expected"),
    "NaN": ({"xyz": [[float("nan"), 0, 0], *XYZ[1:]]}, "NaN is no JSON number; write null where"),
    "all unknown": ({"xyz": [None] * 21}, "only 0 of 21 keypoints are known; expected at least 3"),
    "two coordinates": (
        {"xyz": [row[:2] for row in XYZ]},
        "row 0 of xyz looks like points in an im.*riang",
    ),
    "image keypoints": (
        {"xyz": None, "uv": [[1, 2]]},
        "the key 'uv' looks like points in an image",
    ),
    "millimetres": (
        {"unit": "mm"},
        r'unit = "mm"; expected "m" .metres.; divide the coordinates by 1000',
    ),
    "no unit": ({"unit": None}, r'unit = null; expected "m"'),
    "metres that are mm": (
        {"xyz": (1000 * keypoints()).tolist()},
        "the keypoints span 166.* m, too much for a hand. Are they in millimetres",
    ),
    "too small": (
        {"xyz": (0.001 * keypoints()).tolist()},
        "span only 0.000.* m, too little for a hand",
    ),
    "convention": ({"convention": "mano"}, 'unknown convention "mano"; known: openpose21'),
    "no convention": ({"convention": None}, "unknown convention null; known: openpose21"),
    "frame": ({"frame": -1}, "frame = -1; expected the number of the frame"),
    "frame type": ({"frame": 1.5}, "frame = 1.5; expected the number of the frame"),
    "no frame": ({"frame": None}, "frame = None; expected the number of the frame"),
    "both": ({"parameters": {}}, "both parameters and xyz; expected one of them"),
    "neither": ({"xyz": None}, 'neither parameters nor xyz; expected .*"parameters".* or .*"xyz"'),
    "unknown parameter": (
        {"xyz": None, "parameters": {"index_dip": 0.1}},
        "no parameter 'index_dip' in .*init.json; known: root_tx, index_mcp_flex",
    ),
    "parameter text": (
        {"xyz": None, "parameters": {"root_tx": "1"}},
        "root_tx = 1; expected a finite",
    ),
    "parameters list": (
        {"xyz": None, "parameters": [1]},
        r"parameters = \[1\]; expected names with",
    ),
    "degrees": (
        {"xyz": None, "parameters": {"index_mcp_flex": 45.0}},
        "index_mcp_flex = 45 is implausible in radians; is it in degrees",
    ),
    "root in mm": (
        {"xyz": None, "parameters": {"root_tx": 450.0}},
        "root_tx = 450 .* metres; is it in mill",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_first_poses_are_refused(case: str, tmp_path: Path) -> None:
    changes, message = BAD[case]
    write_init(tmp_path, **changes)
    with pytest.raises(HandtrackError, match=message) as caught:
        read_first_pose(tmp_path / "init.json", NAMES)
    assert "init.json" in str(caught.value)


def test_files_that_are_no_json(tmp_path: Path) -> None:
    path = tmp_path / "init.json"
    with pytest.raises(HandtrackError, match=r"init.json: no such file; expected .*parameters"):
        read_first_pose(path)
    path.write_text('{"frame": 0,\n oops}')
    with pytest.raises(HandtrackError, match=r"init.json: not valid JSON at line 2"):
        read_first_pose(path)
    path.write_text(json.dumps([1, 2]))
    with pytest.raises(HandtrackError, match=r"init.json: a list; expected"):
        read_first_pose(path)
