"""The bounded loop on problems with known answers."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import lsq_linear

from handtrack.model.transform import MovingLimits
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.terms.term import JointSystem


class Linear:
    """½|A x − b|² within bounds."""

    def __init__(self, a, b, low, high):
        self.a, self.b, self.bounds = a, b, np.stack([low, high], axis=1)
        self.limits = MovingLimits.fixed(self.bounds)

    def cost(self, x):
        return 0.5 * float(((self.a @ x - self.b) ** 2).sum())

    def linearize(self, x):
        r = self.a @ x - self.b
        return JointSystem(self.cost(x), self.a.T @ r, self.a.T @ self.a)


class Rosenbrock:
    limits = MovingLimits.fixed(np.tile((-np.inf, np.inf), (2, 1)))

    def residual(self, x):
        return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])

    def cost(self, x):
        return 0.5 * float((self.residual(x) ** 2).sum())

    def linearize(self, x):
        r, j = self.residual(x), np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])
        return JointSystem(self.cost(x), j.T @ r, j.T @ j)


FAR = SolverSettings(iterations=200, cost_tolerance=1e-14)


@pytest.mark.parametrize("seed", range(3))
def test_bounded_linear_problems_agree_with_scipy(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(20, 6)), rng.normal(size=20)
    low, high = -rng.uniform(0.0, 0.1, 6), rng.uniform(0.0, 0.1, 6)
    ours = solve(Linear(a, b, low, high), np.zeros(6), FAR)
    scipys = lsq_linear(a, b, (low, high), tol=1e-14)
    assert ours.cost == pytest.approx(scipys.cost, rel=1e-8)
    assert ours.why == "converged"


def test_ends_by_the_first_step_that_gains_too_little():
    start, costs = np.array([-1.2, 1.0]), []
    settings = replace(FAR, least_gain=0.01)
    found = solve(Rosenbrock(), start, settings, on_iteration=lambda k, x, cost: costs.append(cost))
    gains = -np.diff([Rosenbrock().linearize(start).cost, *costs])
    assert found.why == "converged"
    assert len(gains) > 2
    assert (gains[:-1] > 0.01).all()
    assert gains[-1] <= 0.01


def test_stops_after_the_iteration_in_which_it_is_asked_to():
    """Not only before the first: a person who waits is heard."""
    path, start = [], np.array([-1.2, 1.0])
    stopped = solve(
        Rosenbrock(), start, FAR, lambda: len(path) == 3, lambda *step: path.append(step)
    )
    assert stopped.why == "stopped"
    assert [k for k, _, _ in path] == [1, 2, 3]
    assert_array_equal(stopped.params, path[-1][1])
    assert stopped.cost == path[-1][2]
    assert_allclose(stopped.system.gradient, Rosenbrock().linearize(stopped.params).gradient)
    before = solve(Rosenbrock(), start, FAR, lambda: True)
    assert_array_equal(before.params, start)
    assert (before.iterations, before.why) == (0, "stopped")
    few = solve(Rosenbrock(), start, replace(FAR, iterations=2))
    assert (few.iterations, few.why) == (2, "iterations")


def test_limits_of_the_callers_own_hold_some_parameters_where_they_are():
    problem = Linear(np.eye(3), np.ones(3), np.full(3, -9.0), np.full(3, 9.0))
    free, start = np.array([True, False, True]), np.array([0.2, 0.3, 0.4])
    found = solve(problem, start, FAR, limits=problem.limits.frozen(~free, start)).params
    assert_allclose(found, [1.0, 0.3, 1.0], atol=1e-9)


def test_a_wrong_gradient_is_no_descent_not_convergence():
    class Wrong(Rosenbrock):
        def linearize(self, x):
            system = super().linearize(x)
            return JointSystem(system.cost, -system.gradient, system.hessian)

    assert solve(Wrong(), np.array([-1.2, 1.0]), FAR).why == "no descent"


def test_projection_holds_the_limits_and_never_beats_the_bounds():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        a, b = rng.normal(size=(12, 6)), 2 * rng.normal(size=12)
        problem = Linear(a, b, -rng.uniform(0.05, 0.3, 6), rng.uniform(0.05, 0.3, 6))
        costs = [], []
        ours, papers = (
            solve(problem, np.zeros(6), how, on_iteration=lambda k, x, c, own=own: own.append(c))
            for how, own in zip((FAR, replace(FAR, limits="projection")), costs, strict=True)
        )
        for found, own in zip((ours, papers), costs, strict=True):
            assert (found.params >= problem.bounds[:, 0]).all()
            assert (found.params <= problem.bounds[:, 1]).all()
            assert own == sorted(own, reverse=True)
        assert papers.cost >= ours.cost - 1e-9


@pytest.mark.parametrize("limits", ["bounds", "projection"])
def test_no_step_is_longer_than_allowed_whatever_the_limits(limits):
    """Translations and angles each have a longest step, and a step that is cut keeps its direction."""
    goal = np.array([1.0, -0.4, 0.2, 3.0, 1.5])
    problem = Linear(np.eye(5), goal, np.full(5, -9.0), np.full(5, 9.0))
    settings = SolverSettings(iterations=50, limits=limits, damping=1e-9)
    path = [np.zeros(5)]
    solve(problem, path[0], settings, on_iteration=lambda k, x, cost: path.append(x.copy()))
    steps = np.diff(path, axis=0)
    assert np.abs(steps[:, :3]).max() == pytest.approx(0.05)
    assert np.abs(steps[:, 3:]).max() < 0.5
    assert_allclose(steps[0] / steps[0, 0], goal, atol=1e-6)
    assert_allclose(path[-1], goal, atol=1e-3)
