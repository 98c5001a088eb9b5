"""Poses and twist Jacobians of the compiled kinematics, and ellipsoids that go with their bones."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import load_model
from handtrack.model.kinematics import bone_poses, linearize
from tests.derivatives import check_jacobian
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
    arm = bones.to_world(every, local) - bones.reference
    slopes = jacobian[:, :3] + np.cross(jacobian[:, 3:], arm[:, :, None], axis=1)
    check_jacobian(
        lambda x: bone_poses(model.skeleton, x).to_world(every, local), slopes.reshape(-1, len(params)), params,
        names_columns=model.parameter_names, rtol=0.0, atol=2e-9,
    )  # fmt: skip
