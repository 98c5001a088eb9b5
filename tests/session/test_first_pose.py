"""init.json: both forms read and written, everything else refused."""

from typing import Any

import numpy as np

from handtrack.model.articulated import HandScale
from handtrack.session.first_pose.first_pose import FirstPose, read_first_pose, write_first_pose
from tests.session.small_session import keypoints, write_init

XYZ: list[Any] = keypoints().tolist()
NAMES = ("root_tx", "index_mcp_flex")


def test_keypoints_with_unknown_rows(tmp_path):
    write_init(tmp_path, frame=18, xyz=[None, [None, None, None], *XYZ[2:]])
    pose = read_first_pose(tmp_path / "init.json")
    assert pose.frame == 18
    assert pose.parameters == {}
    assert pose.xyz is not None
    assert np.isnan(pose.xyz[:2]).all()
    np.testing.assert_array_equal(pose.xyz[2:], keypoints()[2:])


def test_parameters_by_name(tmp_path):
    write_init(tmp_path, xyz=None, parameters={"root_tx": 0.1, "index_mcp_flex": 1})
    pose = read_first_pose(tmp_path / "init.json", NAMES)
    assert pose.parameters == {"root_tx": 0.1, "index_mcp_flex": 1.0}
    assert pose.xyz is None


def test_what_is_written_reads_back(tmp_path):
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
