"""Compiled inverse kinematics: sphere and ray, one and two hinges in closed form, a tree of poses extended by a link."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled

TOUCHING = 1e-12  # relative to the squared length: a ray or a circle that touches within rounding
PARALLEL = (
    1e-7  # sine between a direction and an axis below which the turn about it is not determined
)
LIMIT_SLACK = 1e-9  # [rad] beyond a limit that is rounding


@compiled
def pierce(start, origin, ray, length, points, missed, take_nearest):  # pragma: no cover - compiled
    """Fill points (N, 2, 3) where the ray pierces the spheres about start (N, 3), the nearer to the origin first.

    missed (N, 2): 0 pierced, 1 the point of the sphere nearest to the ray instead, 2 no point.
    """
    for n in range(start.shape[0]):
        along, squared = 0.0, 0.0
        for i in range(3):
            arm = start[n, i] - origin[i]
            along += arm * ray[i]
            squared += arm * arm
        inside = length * length - (squared - along * along)
        missed[n, 0], missed[n, 1] = 2, 2
        if inside < -TOUCHING * max(squared, 1e-6):
            if take_nearest and along > 0.0:
                off = np.sqrt(squared - along * along)
                for i in range(3):
                    to_ray = origin[i] + along * ray[i] - start[n, i]
                    points[n, 0, i] = start[n, i] + length / off * to_ray
                missed[n, 0] = 1
            continue
        half = np.sqrt(max(inside, 0.0))
        for k in range(2):
            depth = along - half if k == 0 else along + half
            if depth > 0.0:
                for i in range(3):
                    points[n, k, i] = origin[i] + depth * ray[i]
                missed[n, k] = 0


@compiled
def _dot(a, b):  # pragma: no cover - compiled
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _cross(a, b):  # pragma: no cover - compiled
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def _turned(axis, angle, v, out):  # pragma: no cover - compiled
    """Write v turned by `angle` about the unit `axis`."""
    s, c = np.sin(angle), np.cos(angle)
    k = (1.0 - c) * _dot(axis, v)
    x, y, z = _cross(axis, v)
    out[0] = c * v[0] + s * x + k * axis[0]
    out[1] = c * v[1] + s * y + k * axis[1]
    out[2] = c * v[2] + s * z + k * axis[2]


@compiled
def one_hinge(axis, v, d, otherwise):  # pragma: no cover - compiled
    """Return the angle about `axis` that brings v closest to d; `otherwise` where it makes no difference."""
    along_v, along_d = _dot(axis, v), _dot(axis, d)
    triple = _dot(axis, _cross(v, d))
    flat = _dot(v, d) - along_v * along_d
    free = (_dot(v, v) - along_v**2) * (_dot(d, d) - along_d**2)
    if free < PARALLEL**4 * (_dot(v, v) * _dot(d, d)):
        return otherwise
    return np.arctan2(triple, flat)


@compiled
def two_hinges(a, b, v, d, otherwise_a, otherwise_b, out):  # pragma: no cover - compiled
    """Fill out (2, 2) with the angles (about a, about b) for which turning v about b, then about a,
    gives d.

    Returns how many there are: 2, or 1 where both agree, or where none reaches d and the nearest is
    given. An angle that makes no difference is `otherwise`.

    Parameters
    ----------
    a, b
        Unit axes.
    """
    size = _dot(v, v)
    c = _dot(a, b)
    sine = 1.0 - c * c
    p, q = _dot(a, d), _dot(b, v)
    if sine < PARALLEL**2:  # one axis twice
        out[0, 1] = otherwise_b
        out[0, 0] = one_hinge(a, v, d, otherwise_a + otherwise_b) - otherwise_b
        return 1
    z = np.empty(3)
    if _dot(d, d) - p * p < PARALLEL**2 * size:  # d on the first axis: that turn is free
        out[0, 0] = otherwise_a
        out[0, 1] = one_hinge(b, v, d, otherwise_b)
        return 1
    if size - q * q < PARALLEL**2 * size:  # v on the second axis
        out[0, 1] = otherwise_b
        out[0, 0] = one_hinge(a, v, d, otherwise_a)
        return 1
    x, y = (p - c * q) / sine, (q - c * p) / sine
    left = (size - x * x - y * y - 2.0 * x * y * c) / sine
    count = 2 if left > TOUCHING * size else 1
    w = np.sqrt(max(left, 0.0)) if count == 2 else 0.0
    cross = np.array(_cross(a, b))
    for k in range(count):
        for i in range(3):
            z[i] = x * a[i] + y * b[i] + w * cross[i]
        out[k, 0] = one_hinge(a, z, d, otherwise_a)
        out[k, 1] = one_hinge(b, v, z, otherwise_b)
        w = -w
    return count


@compiled
def into_interval(angle, low, high, near):  # pragma: no cover - compiled
    """Return the angle, whole turns added, inside [low, high] and close to `near`; and how far it is outside.

    Outside it is the nearer end that comes back.
    """
    turn = 2.0 * np.pi
    angle += turn * np.round((near - angle) / turn)
    if low - LIMIT_SLACK <= angle <= high + LIMIT_SLACK:
        return min(max(angle, low), high), 0.0
    up = angle + turn * np.ceil((low - LIMIT_SLACK - angle) / turn)
    if up <= high + LIMIT_SLACK:
        return min(max(up, low), high), 0.0
    above, below = up - high, low - (up - turn)
    return (high, above) if above < below else (low, below)


@compiled
def grow(turns, own, reach, leaves, aims, take_nearest, tolerance):  # pragma: no cover - compiled
    """Return the children of every leaf for one link: rotation, end, angles, parent, target and
    miss of each.

    Miss [m] is from a child's end to the target, infinite where a limit had to be kept. Children
    that miss by more than `tolerance` are dropped, or with `take_nearest` the best one is kept
    where no sibling reaches the target.

    Parameters
    ----------
    turns
        Axes, leader, ratio and interval of all hinges, as a Chain has them.
    own
        Its hinges, first … last − 1.
    leaves
        Rotation (N, 3, 3) before the link, zero-pose axes → world; start (N, 3) world; angles and
        spare (N, K), of the leaf and for turns that are not determined.
    aims
        Targets (N, T, 3) of the end, and which are missed (N, T), as of `pierce`.
    """
    rotation, start, angles, spare = leaves
    targets, missed = aims
    count, hinges, most = 0, angles.shape[1], 2 * missed.size
    parent, which = np.empty(most, np.int64), np.empty(most, np.int8)
    new_rotation, new_end = np.empty((most, 3, 3)), np.empty((most, 3))
    new_angles, miss = np.empty((most, hinges)), np.empty(most)
    free, free_axis = np.empty(2, np.int64), np.empty((2, 3))
    v, d, found = np.empty(3), np.empty(3), np.zeros((2, 2))
    trial, frame, end = np.empty((2, hinges)), np.empty((2, 3, 3)), np.empty((2, 3))
    off, beyond, held = np.empty(2), np.empty(2), np.empty((3, 3))
    for n in range(start.shape[0]):
        frees = _free_and_held(turns, own, angles[n], spare[n], free, free_axis, held)
        for i in range(3):
            v[i] = _dot(held[i], reach)
        for t in range(targets.shape[1]):
            if missed[n, t] == 2:
                continue
            for j in range(3):
                d[j] = 0.0
                for i in range(3):
                    d[j] += rotation[n, i, j] * (targets[n, t, i] - start[n, i])
            solutions = 1
            if frees == 2:
                solutions = two_hinges(
                    free_axis[0], free_axis[1], v, d, spare[n, free[0]], spare[n, free[1]], found
                )
            elif frees == 1:
                found[0, 0] = one_hinge(free_axis[0], v, d, spare[n, free[0]])
            any_exact, best = False, 0
            for s in range(solutions):
                beyond[s] = _set_angles(
                    turns, own, found[s], free[:frees], spare[n], angles[n], trial[s]
                )
                _turn_link(rotation[n], turns[0], own, trial[s], frame[s])
                squared = 0.0
                for i in range(3):
                    end[s, i] = start[n, i] + _dot(frame[s, i], reach)
                    squared += (end[s, i] - targets[n, t, i]) ** 2
                off[s] = np.sqrt(squared)
                if beyond[s] == 0.0 and off[s] <= tolerance and missed[n, t] == 0:
                    any_exact = True
                if off[s] < off[best]:
                    best = s
            for s in range(solutions):
                exact = beyond[s] == 0.0 and off[s] <= tolerance and missed[n, t] == 0
                if not exact and (any_exact or not take_nearest or s != best):
                    continue
                parent[count], which[count] = n, t
                miss[count] = off[s] if beyond[s] == 0.0 and missed[n, t] == 0 else np.inf
                for h in range(hinges):
                    new_angles[count, h] = trial[s, h]
                for i in range(3):
                    new_end[count, i] = end[s, i]
                    for j in range(3):
                        new_rotation[count, i, j] = frame[s, i, j]
                count += 1
    return (
        new_rotation[:count],
        new_end[:count],
        new_angles[:count],
        parent[:count],
        which[:count],
        miss[:count],
    )


@compiled
def _free_and_held(turns, own, angles, spare, free, free_axis, held):  # pragma: no cover - compiled
    """Fill the first two free hinges, their axes, and the turn (3, 3) of all others: R = Π free turns · held."""
    axes, leader, ratio, _ = turns
    frees = 0
    axis, column, turned = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        for j in range(3):
            held[i, j] = 1.0 if i == j else 0.0
    for h in range(own[0], own[1]):
        for i in range(3):
            axis[i] = _dot(held[i], axes[h])
        if leader[h] == h and frees < 2:
            free[frees] = h
            for i in range(3):
                free_axis[frees, i] = axis[i]
            frees += 1
            continue
        if leader[h] == h:  # a third free hinge: what two can do is done without it
            angle = spare[h]
        else:
            angle = angles[h] if leader[h] < 0 else ratio[h] * angles[leader[h]]
        for j in range(3):
            for i in range(3):
                column[i] = held[i, j]
            _turned(axis, angle, column, turned)
            for i in range(3):
                held[i, j] = turned[i]
    return frees


@compiled
def _set_angles(turns, own, found, free, near, angles, out):  # pragma: no cover - compiled
    """Write a solution's angles (K,), followers and limits kept; return how far it was beyond the limits [rad]."""
    _, leader, ratio, interval = turns
    first, last = own
    beyond = 0.0
    for h in range(len(angles)):
        out[h] = near[h] if leader[h] == h and first <= h < last else angles[h]
    for f in range(len(free)):
        h = free[f]
        out[h], over = into_interval(found[f], interval[h, 0], interval[h, 1], near[h])
        beyond += over
    for h in range(first, last):
        if leader[h] >= 0 and leader[h] != h:
            out[h] = ratio[h] * out[leader[h]]
            beyond += max(out[h] - interval[h, 1] - LIMIT_SLACK, 0.0)
            beyond += max(interval[h, 0] - LIMIT_SLACK - out[h], 0.0)
    return beyond


@compiled
def _turn_link(before, axes, own, angles, out):  # pragma: no cover - compiled
    """Write before · Π turns of the own hinges."""
    column, turned = np.empty(3), np.empty(3)
    for j in range(3):
        for i in range(3):
            column[i] = 1.0 if i == j else 0.0
        for h in range(own[1] - 1, own[0] - 1, -1):
            _turned(axes[h], angles[h], column, turned)
            for i in range(3):
                column[i] = turned[i]
        for i in range(3):
            out[i, j] = _dot(before[i], column)
