"""Poses and twist Jacobians of the compiled kinematics, and ellipsoids that go with their bones."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import load_model
from handtrack.model.kinematics import bone_poses, linearize
from handtrack.model.pose_changes import TURN, by_turn, moved
from tests.model import kinematics_reference as reference


def random_params(rng, model, spread=0.5):
    params = rng.normal(scale=spread, size=len(model.parameter_names))
    params[:3] *= 0.3
    return params


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("forearm", [False, True])
def test_compiled_poses_equal_the_plain_form(rng, side, forearm):
    model = load_model(side=side, forearm=forearm)
    for _ in range(5):
        params = random_params(rng, model)
        fast, plain = (
            bone_poses(model.skeleton, params),
            reference.bone_poses(model.skeleton, params),
        )
        assert_allclose(fast.rotation, plain.rotation, atol=1e-13)
        assert_allclose(fast.position, plain.position, atol=1e-13)


@pytest.mark.parametrize("spread", [1e-5, 0.5, 1.0])
def test_a_small_turn_in_world_axes_changes_the_rotation_vector_by_the_matrix(rng, spread):
    pose, turns = rng.normal(scale=spread, size=(1, 26)), np.zeros((3, 1, 26))
    turns[range(3), 0, range(3, 6)] = 1e-5
    differences = [(moved(pose, turn) - moved(pose, -turn))[0, TURN] / 2e-5 for turn in turns]
    assert_allclose(by_turn(pose[0]), np.transpose(differences), atol=1e-9)


@pytest.mark.parametrize("spread", [0.0, 1e-6, 0.5, 2.0])
def test_twist_jacobian_is_the_derivative_of_points_on_bones(rng, spread):
    """At random poses and at rest, where the paper's own form is 0/0."""
    model = load_model(forearm=True)
    params = random_params(rng, model, spread)
    bones, jacobian = linearize(model.skeleton, params)
    every = np.arange(model.skeleton.bone_count)
    local = rng.normal(scale=0.05, size=(len(every), 3))
    points = bones.to_world(every, local)
    for s, name in enumerate(model.parameter_names):
        step = np.zeros(len(params))
        step[s] = 1e-6
        ahead = bone_poses(model.skeleton, params + step).to_world(every, local)
        behind = bone_poses(model.skeleton, params - step).to_world(every, local)
        predicted = jacobian[:, :3, s] + np.cross(jacobian[:, 3:, s], points - bones.reference)
        assert_allclose(predicted, (ahead - behind) / 2e-6, atol=2e-9, err_msg=name)


def test_the_surface_of_each_ellipsoid_is_carried_by_its_bone(rng):
    model = load_model()
    bones = model.bones(model.clipped(model.rest_params() + 0.3 * rng.normal(size=26)))
    towards = rng.normal(size=(20, 3))
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    for flesh in model.flesh.values():
        posed = flesh.posed(bones)
        for e, bone in enumerate(flesh.bone):
            on_it = flesh.centre[e] + (towards * flesh.radii[e]) @ flesh.rotation[e].T
            expected = bones.to_world(int(bone), on_it)
            found = posed.centre[e] + (towards * posed.radii[e]) @ posed.rotation[e].T
            assert_allclose(found, expected, atol=1e-14)
