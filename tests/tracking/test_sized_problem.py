"""Size and poses in one system: its derivatives, and the Schur complement against the full system."""

from __future__ import annotations

import numpy as np
import pytest

from handtrack.model.articulated import HandScale, keypoint_names
from handtrack.model.model_file import load_model
from handtrack.model.size import SizeParameters
from handtrack.observation.observation import Keypoints
from handtrack.solver.levenberg_marquardt import SolverSettings
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.priors.priors import GaussianPrior
from handtrack.tracking.size.sized_problem import SizedProblem, fit_size, linearize_sized
from tests.derivatives import check_gradient

TRUTH = HandScale(1.06, {"thumb": 0.95, "ring": 1.03})


@pytest.fixture
def frames(rng):
    """Joints of a larger hand in three poses, and the mean hand's problems around them."""
    model, larger = load_model(), load_model(scale=TRUTH)
    sigma = np.full(26, 0.7)
    sigma[:6] = np.inf
    problems, poses = [], []
    for _ in range(3):
        pose = larger.clipped(larger.rest_params() + rng.normal(scale=0.2, size=26))
        points = larger.keypoints21(larger.bones(pose)) + rng.normal(scale=1e-3, size=(21, 3))
        seen = Keypoints(keypoint_names(), points, 1e-3)
        prior = GaussianPrior(model.rest, sigma)
        problems.append(Problem(model, [KeypointTerm(model, seen)], [prior]))
        poses.append(pose)
    return problems, poses


def test_one_frame_by_pose_and_size(frames, rng):
    problems, poses = frames
    size = SizeParameters(problems[0].model)
    every = np.ones(len(size.names), bool)
    deviations = rng.normal(scale=0.5, size=len(size.names))

    def cost(both):
        model = size.grown(both[26:])
        problem = problems[0]
        return Problem(model, problem.observation_terms, problem.parameter_terms).cost(both[:26])

    system = linearize_sized(problems[0], size.grown(deviations), size, every, poses[0])
    both = np.concatenate([poses[0], deviations])
    assert system.cost == pytest.approx(cost(both))
    names = (*problems[0].model.transform.names, *size.names)
    check_gradient(cost, system.gradient, both, names)


def test_what_is_left_by_size_alone(frames, rng):
    """Gradient and curvature where the poses follow, along one direction; Gauss-Newton's is that of small residuals."""
    problems, poses = frames
    size = SizeParameters(problems[0].model)
    free = np.array([name != "forearm" for name in size.names])
    tight = SolverSettings(iterations=60, cost_tolerance=1e-15, step_tolerance=1e-12)
    problem = SizedProblem(problems[:2], poses[:2], size, free, tight)
    at = size.deviations(TRUTH)[free]
    along = rng.normal(size=len(at))
    system = problem.linearize(at)
    assert system.cost == pytest.approx(problem.cost(at))
    ahead, behind = (problem.linearize(at + step * along) for step in (1e-2, -1e-2))
    slope, bend = (ahead.cost - behind.cost) / 2e-2, (ahead.gradient - behind.gradient) / 2e-2
    told = system.hessian @ along
    assert slope == pytest.approx(system.gradient @ along, abs=1e-3 * np.linalg.norm(told))
    np.testing.assert_allclose(told, bend, atol=0.03 * np.linalg.norm(bend))


def test_the_size_is_found(frames):
    problems, poses = frames
    scale, fitted = fit_size(problems, poses)
    assert scale.overall == pytest.approx(TRUTH.overall, rel=0.005)
    for part in ("thumb", "ring", "little"):
        assert scale.parts[part] == pytest.approx(TRUTH.parts.get(part, 1.0), rel=0.01)
    larger = load_model(scale=TRUTH)
    for pose, true in zip(fitted, poses, strict=True):
        off = larger.bones(pose).position - larger.bones(true).position
        assert np.linalg.norm(off, axis=1).max() < 0.004


def test_what_is_not_free_stays(frames):
    problems, poses = frames
    names = SizeParameters(problems[0].model).names
    scale, _ = fit_size(problems, poses, np.array([name == "overall" for name in names]))
    assert set(scale.parts.values()) == {1.0}
    assert scale.overall == pytest.approx(TRUTH.overall, rel=0.02)
