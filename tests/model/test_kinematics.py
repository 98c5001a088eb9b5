"""Poses and twist Jacobians of the compiled kinematics, and ellipsoids that go with their bones."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import load_model
from handtrack.model.kinematics import bone_poses, linearize
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
