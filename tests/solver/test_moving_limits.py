"""Limits that move with another parameter: the solver ends where scipy's constrained minimisers end."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import LinearConstraint, minimize

from handtrack import load_model
from handtrack.model.transform import MovingLimits
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.limited_step_kernels import bounded_step, clip, fill_box, new_box
from handtrack.solver.problem import Problem
from handtrack.terms.priors import CorrelatedPrior
from handtrack.terms.term import JointSystem

FAR = SolverSettings(iterations=100, cost_tolerance=1e-13)


def spread_beyond(rng, coupling):
    """Return a problem of bent fingers that are wanted further apart than their limits let them be, and a start."""
    model = load_model(coupling=coupling)
    low, high = model.limits.interval[6:].T
    joint = np.r_[0.1 * rng.normal(size=6), low + rng.uniform(0.2, 0.6, 20) * (high - low)]
    which, by = model.limits.narrowed.T
    joint[by] = rng.uniform(0.3, 1.2, len(by))
    side = rng.integers(0, 2, len(which))
    beyond = np.where(side == 1, 1.0, -1.0) * np.deg2rad(rng.uniform(2.0, 8.0, len(which)))
    joint[which] = model.limits.bounds(joint)[which, side] + beyond
    start = model.transform.solver_params(joint)
    root = 10.0 * rng.normal(size=(26, 26))
    wanted = CorrelatedPrior(joint, root @ root.T + 10.0 * np.eye(26))
    return Problem(model, [], [wanted]), start + 0.1 * rng.normal(size=len(start))


def rows(limits, where):
    """Return matrix and ends (low, high) of the linear constraints that the limits are about a place."""
    matrix, low, high = [], [], []
    for k, p in enumerate(limits.param):
        for column, ends in ((0, low), (1, high)):
            row, by = np.zeros(len(where)), limits.by[k]
            row[p], end = 1.0, limits.first[k, column]
            if np.isinf(end):
                continue
            if by >= 0 and 0.0 < where[by] < limits.end[k]:
                slope = (limits.last[k, column] - end) / limits.end[k]
                row[by] -= slope
            elif by >= 0 and where[by] >= limits.end[k]:
                end = limits.last[k, column]
            matrix.append(row)
            low.append(end if ends is low else -np.inf)
            high.append(end if ends is high else np.inf)
    return LinearConstraint(np.array(matrix), low, high)


@pytest.mark.parametrize("coupling", ["26", "21", "18"])
def test_they_are_the_models_limits_everywhere(rng, coupling):
    model = load_model(coupling=coupling)
    box = new_box(len(model.rest_params()))
    for _ in range(50):
        params = 1.5 * rng.normal(size=len(model.rest_params()))
        fill_box(model.moving_limits, params, box)
        assert_allclose(box.end, model.bounds(params), atol=1e-12)
        clip(model.moving_limits, params, box)
        assert_allclose(model.clipped(params), params, atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_a_step_along_moving_limits_is_the_exact_minimum(seed):
    """Six parameters; the limits of the last three move with the first three, and cross their straight stretch."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(9, 6))
    system = JointSystem(0.0, 3.0 * a.T @ rng.normal(size=9), a.T @ a)
    wide, place = np.tile((-0.4, 0.4), (3, 1)), np.r_[np.full(3, 2.0), np.zeros(3)]
    moving = MovingLimits(
        np.arange(6), np.concatenate([2.0 + wide, wide]), np.r_[np.full(3, -1), [0, 1, 2]],
        np.full(6, 4.0), np.concatenate([wide, 0.2 * wide]),
    )  # fmt: skip
    step = bounded_step(system.hessian, system.gradient, place, moving, 0.0)[1]
    assert step is not None

    def model(x):
        return system.gradient @ x + 0.5 * x @ system.hessian @ x

    exact = minimize(
        lambda x: model(x - place), place, jac=lambda x: system.gradient + system.hessian @ (x - place), method="SLSQP",
        constraints=rows(moving, place), options={"ftol": 1e-14, "maxiter": 500},
    )  # fmt: skip
    assert_allclose(step, exact.x - place, atol=1e-5)
    assert model(step) <= exact.fun + 1e-10


@pytest.mark.parametrize("coupling", ["26", "21", "18"])
def test_bent_fingers_forced_apart_end_where_scipy_ends(coupling):
    followed = 0
    for seed in range(4):
        problem, start = spread_beyond(np.random.default_rng(seed), coupling)
        costs = []
        found = solve(problem, start, FAR, on_iteration=lambda k, x, c, own=costs: own.append(c))
        assert costs == sorted(costs, reverse=True)
        limits = rows(problem.limits, found.params)
        scipys = minimize(
            problem.cost, found.params, jac=lambda x, p=problem: p.linearize(x).gradient, method="SLSQP",
            constraints=limits, options={"ftol": 1e-12, "maxiter": 200},
        )  # fmt: skip
        assert found.cost <= scipys.fun * (1.0 + 1e-6)
        ends = limits.A @ found.params
        assert (ends <= limits.ub + 1e-9).all() and (ends >= limits.lb - 1e-9).all()
        touching = (np.abs(ends - limits.ub) < 1e-9) | (np.abs(ends - limits.lb) < 1e-9)
        followed += int((touching & ((limits.A != 0).sum(axis=1) == 2)).sum())
    assert followed  # else it tests nothing
