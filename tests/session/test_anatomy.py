"""What a result says of the model that it was tracked with: enough to pose it again without handtrack."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handtrack.capture.calibration.rig_file import rig_from_json
from handtrack.session.formats.tables import read_npz, write_npz
from handtrack.tracking.frame.tables.track_model import model_of
from tests.export.sequences import KINDS, sample_rig, sample_sequence


@pytest.mark.parametrize("kind", KINDS)
def test_the_file_alone_tells_where_every_joint_is(kind, tmp_path):
    """A stranger's forward kinematics, from the arrays of the file and SciPy's rotations."""
    _, track = sample_sequence(kind)
    write_npz(tmp_path / "poses.npz", track)
    with np.load(tmp_path / "poses.npz") as file:
        data = dict(file)
    assert (int(data["format"]), str(data["unit"]), float(data["fps"])) == (2, "m", 50.0)
    rest, parents = data["rest_T_bone"], data["parents"]
    for row, values in enumerate(data["parameters"]):
        poses = np.tile(np.eye(4), (len(parents), 1, 1))
        poses[0, :3, :3] = Rotation.from_rotvec(values[3:6]).as_matrix()
        poses[0, :3, 3] = values[:3]
        for bone in range(1, len(parents)):
            local = np.linalg.inv(rest[parents[bone]]) @ rest[bone]
            for hinge in np.flatnonzero(data["hinge_bone"] == bone):
                turn = np.eye(4)
                axis = data["hinge_axis"][hinge] * values[6 + hinge]
                turn[:3, :3] = Rotation.from_rotvec(axis).as_matrix()
                local = local @ turn
            poses[bone] = poses[parents[bone]] @ local
        np.testing.assert_allclose(poses, data["T_world_bone"][row], atol=1e-9)
        carried = poses[data["joint_bone"]]
        joints = (
            np.einsum("jab,jb->ja", carried[:, :3, :3], data["joint_point"]) + carried[:, :3, 3]
        )
        np.testing.assert_allclose(joints, data["joint_positions"][row], atol=1e-9)
    low, high = data["parameter_limits"].T
    assert ((data["parameters"] >= low) & (data["parameters"] <= high)).all()


@pytest.mark.parametrize("kind", KINDS)
def test_the_model_is_built_again_from_the_file(kind, tmp_path):
    model, track = sample_sequence(kind)
    write_npz(tmp_path / "poses.npz", replace(track, take=7, pins='{"pins": []}'))
    back = read_npz(tmp_path / "poses.npz")
    assert (back.take, back.pins, back.fps) == (7, '{"pins": []}', 50.0)
    again = model_of(back)
    assert (again.side, again.kind, again.scale) == (model.side, model.kind, model.scale)
    bones = again.bones(again.transform.solver_params(back.parameters[-1]))
    np.testing.assert_allclose(bones.T_world_bone, back.T_world_bone[-1], atol=1e-12)
    np.testing.assert_array_equal(again.flesh["fine"].radii, model.flesh["fine"].radii)
    rig = rig_from_json(back.cameras, "cameras")
    assert rig.names == ("front", "side")
    np.testing.assert_allclose(rig["side"].rotation, sample_rig()["side"].rotation, atol=1e-12)
