"""The bounded loop on problems with known answers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from handtrack.solver.covariance import covariance
from handtrack.solver.levenberg_marquardt import SolverSettings, bounded_step, solve
from handtrack.terms.bone_system import JointSystem


class Linear:
    """½|A x − b|² within bounds."""

    def __init__(self, a, b, low, high):
        self.a, self.b, self.limits = a, b, np.stack([low, high], axis=1)

    def cost(self, x):
        return 0.5 * float(((self.a @ x - self.b) ** 2).sum())

    def linearize(self, x):
        r = self.a @ x - self.b
        return JointSystem(self.cost(x), self.a.T @ r, self.a.T @ self.a)

    def bounds(self, _):
        return self.limits


class Rosenbrock:
    def residual(self, x):
        return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])

    def cost(self, x):
        return 0.5 * float((self.residual(x) ** 2).sum())

    def linearize(self, x):
        r, j = self.residual(x), np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])
        return JointSystem(self.cost(x), j.T @ r, j.T @ j)

    def bounds(self, _):
        return np.tile((-np.inf, np.inf), (2, 1))


FAR = SolverSettings(iterations=200, step_limit_m=10, step_limit_rad=10, cost_tolerance=1e-14)


@pytest.mark.parametrize("seed", range(8))
def test_bounded_linear_problems_agree_with_scipy(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(20, 6)), rng.normal(size=20)
    low, high = -rng.uniform(0.0, 0.1, 6), rng.uniform(0.0, 0.1, 6)
    ours = solve(Linear(a, b, low, high), np.zeros(6), FAR)
    scipys = lsq_linear(a, b, (low, high), tol=1e-14)
    assert ours.cost == pytest.approx(scipys.cost, rel=1e-8)
    assert ours.converged


def test_a_curved_valley_is_followed_to_its_end():
    summary = solve(Rosenbrock(), np.array([-1.2, 1.0]), FAR)
    np.testing.assert_allclose(summary.params, [1, 1], atol=1e-6)
    assert list(summary.cost_history) == sorted(summary.cost_history, reverse=True)


def test_says_why_it_stopped():
    short = SolverSettings(iterations=2, step_limit_m=10, step_limit_rad=10)
    assert solve(Rosenbrock(), np.array([-1.2, 1.0]), short).why == "iterations"
    assert (
        solve(Rosenbrock(), np.array([-1.2, 1.0]), FAR, should_stop=lambda: True).why == "stopped"
    )


def test_a_wrong_gradient_is_no_descent_not_convergence():
    class Wrong(Rosenbrock):
        def linearize(self, x):
            system = super().linearize(x)
            return JointSystem(system.cost, -system.gradient, system.hessian)

    assert solve(Wrong(), np.array([-1.2, 1.0]), FAR).why == "no descent"


def test_a_step_never_leaves_the_bounds():
    system = JointSystem(1.0, np.array([-5.0, -1.0]), np.array([[1.0, 0.9], [0.9, 1.0]]))
    step = bounded_step(system, np.zeros(2), np.array([-1.0, -1.0]), np.array([0.5, 0.5]), 0.0)
    assert step[0] == pytest.approx(0.5)
    assert step[1] == pytest.approx(0.5)  # 1 − 0.9 · 0.5 = 0.55 would leave


@pytest.mark.parametrize("seed", range(8))
def test_the_bounded_step_is_the_exact_minimum(seed):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(12, 8))
    system = JointSystem(0.0, a.T @ rng.normal(size=12) * 3, a.T @ a)
    low, high = -rng.uniform(0, 0.3, 8), rng.uniform(0, 0.3, 8)
    step = bounded_step(system, np.zeros(8), low, high, 0.0)
    target = -np.linalg.lstsq(a.T, system.gradient, rcond=None)[0]
    exact = lsq_linear(a, target, (low, high), tol=1e-14, method="bvls").x
    np.testing.assert_allclose(step, exact, atol=1e-6)


def test_covariance_reports_what_is_not_seen():
    hessian = np.diag([1e4, 1e-9])
    spread, blind = covariance(hessian)
    assert spread[0, 0] == pytest.approx(1e-4)
    np.testing.assert_allclose(np.abs(blind), [[0], [1]])
