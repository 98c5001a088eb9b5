"""The whole problem: both ledgers, at random poses and at zero, coupled and free."""

import numpy as np
import pytest

from handtrack import Keypoints, load_model
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.priors import GaussianPrior, LinearPrior
from tests.derivatives import check_gradient


@pytest.mark.parametrize(
    ("coupling", "forearm", "at_zero"), [("18", False, False), ("26", True, True)]
)
def test_gradient(rng, coupling, forearm, at_zero):
    model = load_model(coupling=coupling, forearm=forearm)
    params, count = np.zeros(len(model.transform.names)), len(model.parameter_names)
    if not at_zero:
        params = model.rest_params() + rng.normal(scale=0.2, size=len(params))
    params = model.clipped(params)
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
