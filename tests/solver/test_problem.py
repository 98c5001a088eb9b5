"""The whole problem: both ledgers, silhouettes and keypoints, at random poses and at zero, every coupling."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import Keypoints, load_model
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.priors.priors import GaussianPrior, LinearPrior
from handtrack.terms.silhouettes.prepared_silhouette import prepare
from handtrack.terms.silhouettes.silhouette_terms import ConicFieldTerm, CoverageTerm
from tests.derivatives import check_problem
from tests.experiments.scenes.simulated_fields import field_views

# Pixels change hands between ellipsoids: the cost has kinks, so steps are short.
KINKED = {"step": 1e-9, "rtol": 2e-3}
CAMERAS = simulated_rig(2, (160, 120)).cameras


def a_pose(model, rng, at_zero):
    params = np.zeros(len(model.transform.names))
    if not at_zero:
        params = model.rest_params() + rng.normal(scale=0.2, size=len(params))
    params[1] = -0.09
    return model.clipped(params)


def problem_of(model, kind, truth, params, rng):
    flesh, bones = model.flesh["fine"], model.bones(params)
    masks = [prepare(s) for s in mask_views(model, truth, CAMERAS).silhouettes]
    points = model.joint_positions(model.bones(truth))
    terms = {
        "keypoints": lambda: KeypointTerm(model, Keypoints(model.joint_names, points, 0.005)),
        "conic_field": lambda: ConicFieldTerm(field_views(model, truth, CAMERAS), flesh),
        "coverage": lambda: CoverageTerm(masks, flesh, 3.0, bones),
        "narrow": lambda: CoverageTerm(masks, flesh, 1.0, bones, antisymmetric=True),
    }
    count = len(model.parameter_names)
    priors = (
        GaussianPrior(model.rest, np.full(count, 0.4)),
        LinearPrior(rng.normal(size=(3, count))),
    )
    return Problem(model, [terms[kind]()], priors)


@pytest.mark.parametrize(
    ("kind", "coupling", "forearm", "at_zero"),
    [("keypoints", "18", False, False), ("conic_field", "26", True, True), ("coverage", "18", False, False), ("narrow", "26", True, True)],
)  # fmt: skip
def test_gradient(rng, kind, coupling, forearm, at_zero):
    model = load_model(coupling=coupling, forearm=forearm)
    params = a_pose(model, rng, at_zero)
    truth = model.clipped(params + rng.normal(scale=0.03, size=len(params)))
    settings = {} if kind == "keypoints" else KINKED
    check_problem(problem_of(model, kind, truth, params, rng), params, **settings)


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
