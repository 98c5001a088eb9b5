"""Damped Gauss-Newton within limits on a small normal system."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.model.moving_limits import MovingLimits
from handtrack.parallel import one_blas_thread
from handtrack.solver.compiled_problem import CompiledProblem
from handtrack.solver.descent_kernels import (
    CONVERGED,
    NO_DESCENT,
    REJECTIONS,
    USED_UP,
    descend,
    workspace,
)
from handtrack.solver.limited_step_kernels import clip, damped_step, fill_box, new_box
from handtrack.solver.solver_settings import SolverSettings
from handtrack.terms.bone_system import JointSystem


class BoundedProblem(Protocol):
    """What the loop needs of a problem; parameters are (P,)."""

    @property
    def limits(self) -> MovingLimits: ...

    def cost(self, params: Floats[P]) -> float: ...

    def linearize(self, params: Floats[P]) -> JointSystem: ...


@dataclass(frozen=True)
class SolveSummary:
    """Where the loop ended, and why."""

    params: Floats[P]
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


_WHY = {CONVERGED: "converged", USED_UP: "iterations", NO_DESCENT: "no descent"}


@one_blas_thread
def solve(
    problem: BoundedProblem,
    params: Floats[P],
    settings: SolverSettings | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_iteration: Callable[[int, Floats[P], float], None] | None = None,
) -> SolveSummary:
    """Return the minimum that descent reaches from params, within the problem's limits.

    A step is accepted only if the true cost falls; a rejected step is never called converged. Limits hold in either
    way of `settings.limits`: as bounds of the step's own problem, or by projection after it (2004 paper, section 3.4); a problem
    that has none (`Problem.unlimited`) is solved without.
    `on_iteration(k, params, cost)` sees each accepted state. A problem with a compiled form descends there: it is asked
    whether to stop once, before, and tells of its states afterwards.
    """
    settings = settings or SolverSettings()
    compiled: CompiledProblem | None = getattr(problem, "compiled", None)
    if compiled is not None and settings.limits != "projection":
        return _solve_compiled(compiled, params, settings, should_stop, on_iteration)
    limits, box = problem.limits, new_box(len(params))
    params = np.array(params, dtype=float)
    clip(limits, params, box)
    damping = settings.damping
    costs: list[float] = []
    dampings: list[float] = []
    system = problem.linearize(params)
    costs.append(system.cost)
    why, count = "iterations", 0
    for count in range(1, settings.iterations + 1):
        if should_stop is not None and should_stop():
            why = "stopped"
            break
        moved, small, tighten = None, False, settings.tighten
        for _ in range(REJECTIONS):
            step = bounded_step(
                system, params, None if settings.limits == "projection" else limits, damping
            )
            if step is not None:
                trial = params + _shortened(step, settings)
                clip(limits, trial, box)
                cost = problem.cost(trial)
                if cost < system.cost:
                    moved = trial
                    break
                small = bool(np.abs(trial - params).max() < settings.step_tolerance)
                if small:
                    break
            damping *= tighten
            tighten *= 2.0
        dampings.append(damping)
        if moved is None:
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


def _solve_compiled(
    problem: CompiledProblem,
    params: Floats,
    settings: SolverSettings,
    should_stop: Callable[[], bool] | None,
    on_iteration: Callable[[int, Floats, float], None] | None,
) -> SolveSummary:
    size, most = len(params), settings.iterations
    stopped = should_stop is not None and should_stop()
    path, costs = np.empty((most + 1, size)), np.empty(most + 1)
    dampings, work = np.empty(most), workspace(problem.moving, size)
    params = np.array(params, dtype=float)
    why, count, accepted = descend(
        problem.moving, problem.limits, problem.observed, problem.priors, problem.is_block, params,
        0 if stopped else most, settings.damping, settings.least_damping, settings.relax, settings.tighten,
        settings.cost_tolerance, settings.step_tolerance, settings.step_limit_m, settings.step_limit_rad, path, costs,
        dampings, work,
    )  # fmt: skip
    if on_iteration is not None:
        for k in range(1, accepted + 1):
            on_iteration(k, path[k].copy(), float(costs[k]))
    cost = float(costs[accepted])
    system = JointSystem(cost, work.gradient, work.hessian)
    reason = "stopped" if stopped else _WHY[why]
    history = tuple(costs[: accepted + 1].tolist())
    return SolveSummary(
        params, cost, count, reason, history, tuple(dampings[:count].tolist()), system
    )


def bounded_step(
    system: JointSystem, params: Floats[P], limits: MovingLimits | None, damping: float
) -> Floats[P] | None:
    """Return the step that minimises the damped quadratic model within the limits; None if it has no minimum."""
    box, step = new_box(len(params)), np.empty(len(params))
    if limits is not None:
        fill_box(limits, params, box)
    floor = 1e-9 * max(float(np.diag(system.hessian).max()), 1e-30)
    found = damped_step(system.hessian, system.gradient, params, box, damping, floor, step)
    return step if found else None


def _shortened(step: Floats, settings: SolverSettings) -> Floats:
    """Return the step scaled down so that neither translations (first three) nor angles jump."""
    longest = max(
        float(np.abs(step[:3]).max()) / settings.step_limit_m,
        float(np.abs(step[3:]).max(initial=0.0)) / settings.step_limit_rad,
    )
    return step / longest if longest > 1.0 else step
