"""Compiled step to the minimum of a quadratic model within limits, for the plain solver and for polishing.

Primal active set: go to the minimum over the free parameters, stop at the first limit that is met and hold it; at a
minimum, release the held parameter that is pulled inwards most. A limit that moves with another parameter is followed:
a parameter held at it moves with the other one, so that the end is a true minimum within the limits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handtrack.arrays import Floats, Ints
from handtrack.compiled import compiled, inlined

_AT_LIMIT = 1e-11  # [m, rad] closer than this counts as at the limit


class Box(NamedTuple):
    """Limits (P, 2) that hold at a place, low and high; each may move with one other parameter (`by` ≥ 0) at a rate `slope`."""

    end: Floats
    by: Ints
    slope: Floats


@compiled
def new_box(size):  # pragma: no cover - compiled
    """Return a Box to be filled."""
    return Box(np.empty((size, 2)), np.empty((size, 2), np.int64), np.empty((size, 2)))


@compiled
def fill_box(limits, params, box):  # pragma: no cover - compiled
    """Find the limits that hold at params (P,), and how they move. limits: model/limits.py."""
    box.by[:], box.slope[:] = -1, 0.0
    for p in range(params.shape[0]):
        box.end[p, 0], box.end[p, 1] = -np.inf, np.inf
    for k in range(limits.param.shape[0]):
        p, by, tied, way, share = limits.param[k], limits.by[k], -1, 1.0, 0.0
        if by >= 0:
            way = limits.end[k]
            share = params[by] / way
            if 0.0 < share < 1.0 and by != p:
                tied = by
            share = min(max(share, 0.0), 1.0)
        for side in range(2):
            place, change, sign = limits.first[k, side], 0.0, 2.0 * side - 1.0
            if by >= 0:
                change = limits.last[k, side] - place
                place += share * change
            if sign * place < sign * box.end[p, side]:
                box.end[p, side], box.by[p, side] = place, tied
                box.slope[p, side] = change / way if tied >= 0 else 0.0
    for p in range(params.shape[0]):
        if box.end[p, 0] > box.end[p, 1]:
            middle = 0.5 * (box.end[p, 0] + box.end[p, 1])
            for side in range(2):
                box.end[p, side], box.by[p, side], box.slope[p, side] = middle, -1, 0.0


@compiled
def clip(limits, params, box):  # pragma: no cover - compiled
    """Move params into the limits that hold there, and leave `box` filled for the place."""
    # a second pass where limits move: what they move with may itself have been moved
    for _ in range(2 if (limits.by >= 0).any() else 1):
        fill_box(limits, params, box)
        for p in range(params.shape[0]):
            params[p] = min(max(params[p], box.end[p, 0]), box.end[p, 1])


@inlined
def _tie(box, held, p):  # pragma: no cover - compiled
    """Return what a held parameter moves with, and how fast; −1 where it stays."""
    if held[p] == 0:
        return -1, 0.0
    side = (held[p] + 1) // 2
    return box.by[p, side], box.slope[p, side]


@inlined
def _stopped(box, p, place, slope):  # pragma: no cover - compiled
    """Return which limit a descent of this slope stops at: −1 the low one, 1 the high one, 0 none."""
    if slope < 0.0 and place >= box.end[p, 1] - _AT_LIMIT:
        return 1
    return -1 if slope > 0.0 and place <= box.end[p, 0] + _AT_LIMIT else 0


@compiled
def fold(box, held, matrix, vector):  # pragma: no cover - compiled
    """Fold rows and columns of held parameters into those that they move with: Eᵀ H E and Eᵀ g in place."""
    size = vector.shape[0]
    for p in range(size):
        by, slope = _tie(box, held, p)
        if by >= 0 and slope != 0.0:
            vector[by] += slope * vector[p]
            for r in range(size):
                matrix[by, r] += slope * matrix[p, r]
            for r in range(size):
                matrix[r, by] += slope * matrix[r, p]


@compiled
def _fold_gradient(box, held, slope):  # pragma: no cover - compiled
    """Fold a gradient only."""
    for p in range(slope.shape[0]):
        by, rate = _tie(box, held, p)
        if by >= 0:
            slope[by] += rate * slope[p]


@compiled
def hold(params, gradient, box, held, folded):  # pragma: no cover - compiled
    """Mark what stands at a limit and is pushed outwards: 1 high, −1 low. folded: the gradient along the limits."""
    size = params.shape[0]
    for p in range(size):
        folded[p] = gradient[p]
        held[p] = _stopped(box, p, params[p], gradient[p])
    _fold_gradient(box, held, folded)
    for p in range(size):  # what others follow may now be pushed the other way
        if held[p] == 0:
            held[p] = _stopped(box, p, params[p], folded[p])
        elif held[p] * folded[p] > 0.0:
            held[p] = 0


@compiled
def _cholesky_solve(matrix, right, count):  # pragma: no cover - compiled
    """Solve in place with the upper triangle of matrix (count, count); False unless positive definite."""
    for j in range(count):
        pivot = matrix[j, j]
        if not pivot > 0.0:
            return False
        root = np.sqrt(pivot)
        scale = 1.0 / root
        for k in range(j, count):
            matrix[j, k] *= scale
        for i in range(j + 1, count):
            x = matrix[j, i]
            if x != 0.0:
                for k in range(i, count):
                    matrix[i, k] -= x * matrix[j, k]
    for i in range(count):
        right[i] /= matrix[i, i]
        x = right[i]
        for k in range(i + 1, count):
            right[k] -= matrix[i, k] * x
    for i in range(count - 1, -1, -1):
        x = right[i]
        for k in range(i + 1, count):
            x -= matrix[i, k] * right[k]
        right[i] = x / matrix[i, i]
    return True


@compiled
def limited_step(hessian, gradient, params, box, step):  # pragma: no cover - compiled
    """Fill the step (P,) that minimises the quadratic model within the limits; False if it has no minimum."""
    size = params.shape[0]
    held, index = np.empty(size, np.int64), np.empty(size, np.int64)
    goal, slope, right = np.empty(size), np.empty(size), np.empty(size)
    folded, compact = np.empty((size, size)), np.empty((size, size))
    hold(params, gradient, box, held, slope)
    largest = 0.0
    for p in range(size):
        step[p] = 0.0
        largest = max(largest, abs(gradient[p]))
    for _ in range(3 * size):
        # goal of the held ones where the free ones do not move; right side for the free ones
        for p in range(size):
            goal[p] = 0.0
            if held[p] != 0:
                goal[p] = box.end[p, (held[p] + 1) // 2] - params[p]
        for p in range(size):
            by, rate = _tie(box, held, p)
            if by >= 0 and held[by] != 0:
                goal[p] += rate * goal[by]
        tied = False
        for p in range(size):
            slope[p] = gradient[p]
            by, rate = _tie(box, held, p)
            tied = tied or (by >= 0 and rate != 0.0)
        for p in range(size):
            if goal[p] != 0.0:
                for r in range(size):
                    slope[r] += hessian[r, p] * goal[p]
        source = hessian
        if tied:
            for p in range(size):
                for r in range(size):
                    folded[p, r] = hessian[p, r]
            fold(box, held, folded, slope)
            source = folded
        count = 0
        for p in range(size):
            if held[p] == 0:
                index[count] = p
                right[count] = -slope[p]
                count += 1
        for i in range(count):
            for k in range(i, count):
                compact[i, k] = source[index[i], index[k]]
        if not _cholesky_solve(compact, right, count):
            return False
        for i in range(count):
            goal[index[i]] = right[i]
        if tied:
            for p in range(size):
                by, rate = _tie(box, held, p)
                if by >= 0 and held[by] == 0:
                    goal[p] += rate * goal[by]
        # how far towards it until the first limit
        room, first, met = 1.0, -1, 0
        for i in range(count):
            p = index[i]
            move = goal[p] - step[p]
            for way in (1, -1):
                side = (way + 1) // 2
                end, by, tilt = box.end[p, side], box.by[p, side], box.slope[p, side]
                if np.isinf(end):
                    continue
                rate, gap = move, end - params[p] - step[p]
                if by >= 0:
                    rate -= tilt * (goal[by] - step[by])
                    gap += tilt * step[by]
                if way * rate > 1e-15:
                    share = max(gap / rate, 0.0)
                    if share < room:
                        room, first, met = share, p, way
        for p in range(size):
            step[p] += room * (goal[p] - step[p])
        if first >= 0:
            held[first] = met
            continue
        # at the minimum over the free ones: release the held one that is pulled inwards most
        for p in range(size):
            slope[p] = gradient[p]
        for p in range(size):
            if step[p] != 0.0:
                for r in range(size):
                    slope[r] += hessian[r, p] * step[p]
        _fold_gradient(box, held, slope)
        worst, most = -1, 1e-12 * (1.0 + largest)
        for p in range(size):
            if held[p] * slope[p] > most:
                worst, most = p, held[p] * slope[p]
        if worst < 0:
            return True
        held[worst] = 0
    return True


@compiled
def bounded_step(hessian, gradient, params, limits, damping):  # pragma: no cover - compiled
    """Return whether the quadratic model has a minimum within the limits, damped as Levenberg and Marquardt do, and the step to it."""
    box, step, floor = new_box(params.shape[0]), np.empty(params.shape[0]), 1e-30
    fill_box(limits, params, box)
    for p in range(params.shape[0]):
        floor = max(floor, hessian[p, p])
    damped = hessian.copy()
    for p in range(params.shape[0]):
        damped[p, p] += damping * hessian[p, p] + 1e-9 * floor
    return limited_step(damped, gradient, params, box, step), step


@compiled
def stepped(limits, params, step, longest):  # pragma: no cover - compiled
    """Return where a step leads within the limits, and the largest change.

    A step that is too long keeps its direction.

    Parameters
    ----------
    longest
        Of a translation (first three), of an angle.
    """
    shorter = 1.0
    for p in range(params.shape[0]):
        shorter = max(shorter, abs(step[p]) / longest[0 if p < 3 else 1])
    trial = clipped(limits, params + step / shorter)
    return trial, np.abs(trial - params).max()


@compiled
def clipped(limits, params):  # pragma: no cover - compiled
    """Return params moved into the limits that hold there."""
    moved = params.copy()
    clip(limits, moved, new_box(params.shape[0]))
    return moved
