"""Compiled damped Newton with limits, over many starts. The plain form is solver/levenberg_marquardt.py.

Two things differ from there. The step uses the exact Hessian where it is positive on the free
directions, and Gauss-Newton's where it is not: one camera leaves flat valleys, where Gauss-Newton creeps. And the damping
follows the ratio of true to predicted descent.
"""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled
from handtrack.sampling.keypoint_kernels import keypoint_cost, keypoint_system
from handtrack.solver.limited_step_kernels import (
    clip,
    fill_box,
    fold,
    hold,
    limited_step,
    new_box,
)

_DAMPING, _LEAST_DAMPING = (
    1e-3,
    1e-12,
)  # λ at first, and at least, as a share of the Gauss-Newton diagonal
_LONGEST_M, _WIDEST_RAD = 0.3, 0.5  # of one step
_REJECTIONS = 20  # trials at one linearisation before giving up
_FLOOR = (
    1e-12  # share of the largest diagonal entry added to all: nothing may be seen of a parameter
)
_HELD = 1e3  # diagonal of held parameters in the Hessian that is given back, in units of Gauss-Newton's: no least eigenvalue
_ROUNDING = 1e-13  # a share of the cost that cannot be told from rounding


@compiled
def polish_all(problem, params, iterations, tolerance):  # pragma: no cover - compiled
    """Polish params (N, P) in place; return costs, gradient norms (N,) and two matrices (N, P, P).

    The matrices: Gauss-Newton and priors; and the exact Hessian along the limits, with a large diagonal and nothing
    else for held parameters.
    """
    starts, size = params.shape
    cost, norm = np.zeros(starts), np.zeros(starts)
    normal_out, hessian_out = np.zeros((starts, size, size)), np.zeros((starts, size, size))
    box, limits = new_box(size), problem.limits
    slope, step = np.zeros(size), np.zeros(size)
    trial, held = np.zeros(size), np.zeros(size, np.int64)
    damped, folded = np.zeros((size, size)), np.zeros((size, size))
    for n in range(starts):
        x = params[n]
        clip(limits, x, box)
        now, gradient, normal, curvature = keypoint_system(problem, x)
        level, used = _DAMPING, 0
        while now < np.inf:
            hold(x, gradient, box, held, slope)
            norm[n] = 0.0
            for p in range(size):
                if held[p] == 0:
                    norm[n] += slope[p] * slope[p] / max(normal[p, p], 1e-30)
            norm[n] = np.sqrt(norm[n])
            if norm[n] < tolerance or used == iterations:
                break
            used += 1
            moved, newton, refused, tighten = False, True, False, 4.0
            floor = 1e-30
            for p in range(size):
                floor = max(floor, _FLOOR * normal[p, p])
            for _ in range(_REJECTIONS):
                for p in range(size):
                    for r in range(size):
                        damped[p, r] = normal[p, r] + (curvature[p, r] if newton else 0.0)
                    damped[p, p] += level * normal[p, p] + floor
                if not limited_step(damped, gradient, x, box, step):
                    if not newton:
                        level = max(10.0 * level, 1e-8)
                    newton = False
                    continue
                longest = 1.0
                for p in range(size):
                    most = _LONGEST_M if p < 3 else _WIDEST_RAD
                    longest = max(longest, abs(step[p]) / most)
                predicted = 0.0
                for p in range(size):
                    step[p] /= longest
                    trial[p] = x[p] + step[p]
                for p in range(size):
                    predicted -= step[p] * gradient[p]
                    for r in range(size):
                        matrix = normal[p, r] + (curvature[p, r] if newton else 0.0)
                        predicted -= 0.5 * step[p] * matrix * step[r]
                clip(limits, trial, box)
                there = keypoint_cost(problem, trial)
                small = predicted <= _ROUNDING * now
                if there < now or (small and there <= now * (1.0 + _ROUNDING)):
                    moved = True
                    gain = (now - there) / max(predicted, 1e-300)
                    if small or (gain > 0.75 and not refused):
                        level = max(0.1 * level, _LEAST_DAMPING)
                    elif gain < 0.25:
                        level *= 2.0
                    break
                fill_box(limits, x, box)
                level, refused = max(tighten * level, 1e-6), True
                tighten *= 2.0
            if not moved:
                break
            for p in range(size):
                x[p] = trial[p]
            now, gradient, normal, curvature = keypoint_system(problem, x)
        cost[n] = now
        if not now < np.inf:
            norm[n] = np.inf
            continue
        for p in range(size):
            for r in range(size):
                normal_out[n, p, r] = normal[p, r]
        for p in range(size):
            for r in range(size):
                folded[p, r] = normal[p, r] + curvature[p, r]
        fold(box, held, folded, slope)
        for p in range(size):
            for r in range(size):
                free = held[p] == 0 and held[r] == 0
                hessian_out[n, p, r] = folded[p, r] if free else 0.0
            if held[p] != 0:
                hessian_out[n, p, p] = _HELD * max(normal[p, p], 1e-30)
    return cost, norm, normal_out, hessian_out
