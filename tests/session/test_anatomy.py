"""What a result says of the model that it was tracked with: enough to pose it again without handtrack."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handtrack.capture.calibration.rig_file import rig_from_json
from handtrack.errors import HandtrackError
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


def test_a_file_of_format_1_opens_and_its_shipped_model_is_known(tmp_path):
    model, track = sample_sequence("left")
    path = tmp_path / "poses.npz"
    write_npz(path, replace(track, definition=None, fps=None, cameras=None))
    with np.load(path) as file:
        assert int(file["format"]) == 1
        assert "parents" not in file.files
    again = model_of(read_npz(path))
    np.testing.assert_array_equal(again.skeleton.offset, model.skeleton.offset)


def test_what_is_not_known_of_a_model_is_said():
    _, track = sample_sequence("claw")
    with pytest.raises(HandtrackError, match="how its model 'claw' is built is not in the file"):
        model_of(replace(track, definition=None))
    with pytest.raises(HandtrackError, match=r"a.npz: the model's definition is no JSON"):
        model_of(replace(track, definition="{"), "a.npz")
    unknown = '"narrowing": {"pairs": [["a", "b"]], "at_deg": 9, "to": 1}, "kind"'
    with pytest.raises(HandtrackError, match="no freedom 'a' in narrowing in the model definition"):
        model_of(replace(track, definition=track.definition.replace('"kind"', unknown)))
    with pytest.raises(
        HandtrackError, match=r"its joints are not those of the model 'claw' \(mount, top"
    ):
        model_of(replace(track, joint_names=("top", *track.joint_names[1:])))
