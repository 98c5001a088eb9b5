"""Damped Gauss-Newton with bounds, on a small normal system. Knows neither hands nor cameras."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from handtrack.arrays import Floats
from handtrack.terms.bone_system import JointSystem


class BoundedProblem(Protocol):
    """What the loop needs of a problem; parameters are (P,)."""

    def cost(self, params: Floats) -> float: ...

    def linearize(self, params: Floats) -> JointSystem: ...

    def bounds(self, params: Floats) -> Floats: ...


@dataclass(frozen=True)
class SolverSettings:
    """How hard to try."""

    iterations: int = 10
    """linearisations at most"""
    limits: str = "bounds"
    """`bounds`: no step leaves the limits, found together with it; `projection`: a step that knows no limits is
    moved back to them afterwards (the 2004 paper's), which can stick where joints work together"""
    damping: float = 1e-2
    """first λ, as a share of the Hessian's diagonal; kept above `least_damping`, for two or three
    binary cameras leave weak directions"""
    least_damping: float = 1e-6
    relax: float = 0.4
    """λ is multiplied by this after a step that lowered the cost"""
    tighten: float = 4.0
    """and by this after one that did not"""
    cost_tolerance: float = 1e-7
    """stop when a step lowers the cost by a smaller share than this"""
    step_tolerance: float = 1e-7
    """stop when no parameter moves by more than this [m, rad]"""
    step_limit_m: float = 0.05
    """longest move of a translation in one step"""
    step_limit_rad: float = 0.5
    """widest turn of an angle in one step"""


@dataclass(frozen=True)
class SolveSummary:
    """Where the loop ended, and why."""

    params: Floats
    cost: float
    iterations: int
    why: str
    """`converged`, `iterations` (used up), `no descent`, or `stopped` (asked to)"""
    cost_history: tuple[float, ...]
    damping_history: tuple[float, ...]
    system: JointSystem
    """the last linearisation"""

    @property
    def converged(self) -> bool:
        return self.why == "converged"


_REJECTIONS = 8  # trials at one linearisation before giving up


def solve(
    problem: BoundedProblem,
    params: Floats,
    settings: SolverSettings | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_iteration: Callable[[int, Floats, float], None] | None = None,
) -> SolveSummary:
    """Return the minimum that descent reaches from params (P,), within the problem's bounds.

    A step is accepted only if the true cost falls; a rejected step is never called converged. Limits hold in either
    way of `settings.limits`: as bounds of the step's own problem, or by projection after it (2004 paper, section 3.4).
    `on_iteration(k, params, cost)` sees each accepted state.
    """
    settings = settings or SolverSettings()
    bounds = problem.bounds(params)
    params = np.clip(params, bounds[:, 0], bounds[:, 1])
    damping = settings.damping
    costs: list[float] = []
    dampings: list[float] = []
    system = problem.linearize(params)
    costs.append(system.cost)
    everywhere = np.full(len(params), np.inf)
    why, count = "iterations", 0
    for count in range(1, settings.iterations + 1):
        if should_stop is not None and should_stop():
            why = "stopped"
            break
        bounds = problem.bounds(params)
        low, high = np.minimum(bounds[:, 0], params), np.maximum(bounds[:, 1], params)
        moved = None
        for _ in range(_REJECTIONS):
            if settings.limits == "projection":
                step = bounded_step(system, params, -everywhere, everywhere, damping)
            else:
                step = bounded_step(system, params, low, high, damping)
            step = _shortened(step, settings)
            trial = np.clip(params + step, low, high)
            there = problem.bounds(trial)  # limits that narrow with another parameter have moved
            trial = np.clip(trial, there[:, 0], there[:, 1])
            cost = problem.cost(trial)
            if cost < system.cost:
                moved = trial
                break
            if np.abs(trial - params).max() < settings.step_tolerance:
                break
            damping *= settings.tighten
        dampings.append(damping)
        if moved is None:
            small = np.abs(trial - params).max() < settings.step_tolerance
            why = "converged" if small else "no descent"
            break
        gain = system.cost - cost
        largest = float(np.abs(moved - params).max())
        damping = max(damping * settings.relax, settings.least_damping)
        params = moved
        costs.append(cost)
        if on_iteration is not None:
            on_iteration(count, params, cost)
        if (
            gain <= settings.cost_tolerance * max(abs(cost), 1e-300)
            or largest < settings.step_tolerance
        ):
            why = "converged"
            break
        if count < settings.iterations:
            system = problem.linearize(params)
    return SolveSummary(params, costs[-1], count, why, tuple(costs), tuple(dampings), system)


def bounded_step(
    system: JointSystem, params: Floats, low: Floats, high: Floats, damping: float
) -> Floats:
    """Return the step (P,) that minimises the damped quadratic model within the bounds.

    Primal active set: go to the minimum over the free parameters, stop at the first bound that is met and
    hold it; at a minimum, release the held parameter whose multiplier points back inside most.
    """
    hessian, gradient = system.hessian, system.gradient
    diagonal = np.diag(hessian)
    floor = 1e-9 * max(float(diagonal.max()), 1e-30)
    damped = hessian + np.diag(damping * diagonal + floor)
    least, most = low - params, high - params
    step = np.zeros(len(params))
    held = ((least >= 0) & (gradient > 0)) | ((most <= 0) & (gradient < 0))
    for _ in range(3 * len(params)):
        free = ~held
        goal = step.copy()
        goal[free] = _solve_positive(
            damped[np.ix_(free, free)], -gradient[free] - damped[np.ix_(free, held)] @ step[held]
        )
        move = goal - step
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(move > 0, (most - step) / move, (least - step) / move)
        room[~free | (move == 0)] = np.inf
        first = int(np.argmin(room))
        if room[first] < 1.0:
            step = step + max(room[first], 0.0) * move
            step[first] = most[first] if move[first] > 0 else least[first]
            held[first] = True
            continue
        step = goal
        slope = gradient + damped @ step
        inward = np.where(step <= least, -slope, slope) * held
        worst = int(np.argmax(inward))
        if inward[worst] <= 1e-12 * (1.0 + np.abs(gradient).max()):
            break
        held[worst] = False
    return step


def _solve_positive(matrix: Floats, right: Floats) -> Floats:
    if len(right) == 0:
        return right
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return np.linalg.lstsq(matrix, right, rcond=None)[0]


def _shortened(step: Floats, settings: SolverSettings) -> Floats:
    """Return the step scaled down so that neither translations (first three) nor angles jump."""
    longest = max(
        float(np.abs(step[:3]).max()) / settings.step_limit_m,
        float(np.abs(step[3:]).max(initial=0.0)) / settings.step_limit_rad,
    )
    return step / longest if longest > 1.0 else step
