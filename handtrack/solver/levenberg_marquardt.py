"""Damped Gauss-Newton within limits on a small normal system."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.model.transform import MovingLimits
from handtrack.parallel import one_blas_thread
from handtrack.solver.limited_step_kernels import bounded_step, clipped, stepped
from handtrack.solver.problem import Problem
from handtrack.solver.solver_settings import SolverSettings
from handtrack.terms.term import JointSystem


@dataclass(frozen=True)
class SolveSummary:
    """Where the loop ended, and why."""

    params: Floats[P]
    iterations: int
    why: str
    """`converged`, `iterations` (used up), `no descent`, or `stopped` (asked to)"""
    system: JointSystem
    """the last linearisation"""

    @property
    def cost(self) -> float:
        return self.system.cost


REJECTIONS = 5
"""trials at one linearisation before giving up"""
_LONGEST = 0.05, 0.5
"""longest move of a translation in one step [m], and widest turn of an angle [rad]"""
_LEAST_DAMPING = 1e-6
"""two or three binary cameras leave weak directions"""
_RELAX, _TIGHTEN = 0.4, 4.0
"""λ is multiplied by the first after a step that lowered the cost, by the second after one that did not; each further one at the
same place doubles that (Nielsen 1999)"""


@one_blas_thread
def solve(
    problem: Problem,
    params: Floats[P],
    settings: SolverSettings | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_iteration: Callable[[int, Floats[P], float], None] | None = None,
    limits: MovingLimits | None = None,
) -> SolveSummary:
    """Return the minimum that descent reaches from params, within limits.

    A step is accepted only if the true cost falls; a rejected step is never called converged. Each trial is linearised at once: where
    it is accepted, that is the next system already.

    Parameters
    ----------
    should_stop
        Asked before each iteration.
    on_iteration
        Called with (k, params, cost) for each accepted state.
    limits
        In place of the problem's; `settings.limits` says whether they are bounds of the step's own problem, or held by
        projection after it (2004 paper, section 3.4).
    """
    settings, limits = settings or SolverSettings(), limits or problem.limits
    bounds = MovingLimits.none() if settings.limits == "projection" else limits
    params = clipped(limits, np.array(params, dtype=float))
    damping, system = settings.damping, problem.linearize(params)
    why, count = "iterations", 0
    for count in range(1, settings.iterations + 1):
        if should_stop is not None and should_stop():
            why, count = "stopped", count - 1
            break
        moved, small, tighten = None, False, _TIGHTEN
        for _ in range(REJECTIONS):
            has_minimum, step = bounded_step(
                system.hessian, system.gradient, params, bounds, damping
            )
            if has_minimum:
                trial, largest = stepped(limits, params, step, _LONGEST)
                there = problem.linearize(trial)
                if there.cost < system.cost:
                    moved = there
                    break
                small = largest < settings.step_tolerance
                if small:
                    break
            damping *= tighten
            tighten *= 2.0
        if moved is None:
            why = "converged" if small else "no descent"
            break
        gain = system.cost - moved.cost
        damping = max(damping * _RELAX, _LEAST_DAMPING)
        params, system = trial, moved
        if on_iteration is not None:
            on_iteration(count, params, system.cost)
        share = settings.cost_tolerance * max(abs(system.cost), 1e-300)
        least = max(share, settings.least_gain)
        if gain <= least or largest < settings.step_tolerance:
            why = "converged"
            break
    return SolveSummary(params, count, why, system)
