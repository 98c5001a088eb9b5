"""The whole problem: both ledgers, at random poses and at zero, coupled and free."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import Keypoints, load_model
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.priors.priors import GaussianPrior, LinearPrior
from tests.derivatives import check_gradient


def a_pose(model, rng, at_zero):
    params = np.zeros(len(model.transform.names))
    if not at_zero:
        params = model.rest_params() + rng.normal(scale=0.2, size=len(params))
    params[1] = -0.09
    return model.clipped(params)


@pytest.mark.parametrize(
    ("coupling", "forearm", "at_zero"), [("18", False, False), ("26", True, True)]
)
def test_gradient(rng, coupling, forearm, at_zero):
    model = load_model(coupling=coupling, forearm=forearm)
    params, count = a_pose(model, rng, at_zero), len(model.parameter_names)
    points = model.joint_positions(model.bones(params)) + rng.normal(scale=0.01, size=(1, 3))
    seen = KeypointTerm(model, Keypoints(model.joint_names, points, 0.005))
    priors = (
        GaussianPrior(model.rest, np.full(count, 0.4)),
        LinearPrior(rng.normal(size=(3, count))),
    )
    problem = Problem(model, [seen], priors)
    system = problem.linearize(params)
    assert system.cost == pytest.approx(problem.cost(params))
    check_gradient(problem.cost, system.gradient, params, model.transform.names, rtol=1e-5)


def test_a_coupled_system_is_the_free_one_seen_through_the_coupling(rng):
    """H → TᵀHT, g → Tᵀg."""
    free, coupled = load_model(coupling="26"), load_model(coupling="18")
    params = a_pose(coupled, rng, False)
    joint = coupled.joint_params(params)
    truth = a_pose(free, rng, False)
    points = free.joint_positions(free.bones(truth))
    seen = Keypoints(free.joint_names, points, 0.005)
    full = Problem(free, [KeypointTerm(free, seen)]).linearize(joint)
    part = Problem(coupled, [KeypointTerm(coupled, seen)]).linearize(params)
    matrix = coupled.transform.matrix
    assert_allclose(part.gradient, matrix.T @ full.gradient, rtol=1e-9)
    assert_allclose(part.hessian, matrix.T @ full.hessian @ matrix, rtol=1e-7, atol=1e-3)
