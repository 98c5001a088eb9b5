"""Compiled overlap of ellipsoids. The plain form: tests/terms/collision_reference.py; docs/explanation/solver.md."""

from __future__ import annotations

from itertools import product

import numpy as np

from handtrack.compiled import compiled_as_numpy
from handtrack.terms.bone_kernels import fill_arm, posed_shapes

_STEPS = 30
_DONE = 1e-20
"""squared tangential step [rad²] at which a direction is found"""
_WAYS = np.array([way[::-1] for way in product((-1.0, 0.0, 1.0), repeat=3) if any(way)])
_WAYS /= np.linalg.norm(_WAYS, axis=1, keepdims=True)
"""(26, 3) along the world's axes and diagonals"""


@compiled_as_numpy
def _supported(shape, n, out):  # pragma: no cover - compiled
    """Write D n / h and return the support h = √(nᵀ D n): how far the ellipsoid reaches along n from its centre."""
    for i in range(3):
        out[i] = shape[i, 0] * n[0] + shape[i, 1] * n[1] + shape[i, 2] * n[2]
    h = np.sqrt(out[0] * n[0] + out[1] * n[1] + out[2] * n[2])
    for i in range(3):
        out[i] /= h
    return h


@compiled_as_numpy
def _gap(delta, one, other, n, p, q):  # pragma: no cover - compiled
    """Return f(n) = n·δ − h₁(n) − h₂(n), the free space along n; p, q: the farthest points from either centre."""
    h = _supported(one, n, p)
    k = _supported(other, n, q)
    return delta[0] * n[0] + delta[1] * n[1] + delta[2] * n[2] - h - k, h, k


@compiled_as_numpy
def _climb(delta, one, other, n, p, q):  # pragma: no cover - compiled
    """Move the unit vector n to a maximum of f by Newton's steps on the sphere; returns f there.

    Stops as soon as f > 0: along that n the two are apart, and how far does not matter.
    """
    t, u, g = np.empty(3), np.empty(3), np.empty(3)
    trial = np.empty(3)
    f, h, k = _gap(delta, one, other, n, p, q)
    for _ in range(_STEPS):
        if f > 0.0:
            return f
        small = 0
        for i in range(1, 3):
            if abs(n[i]) < abs(n[small]):
                small = i
        a, b = (small + 1) % 3, (small + 2) % 3
        size = np.sqrt(n[a] * n[a] + n[b] * n[b])
        t[small], t[a], t[b] = 0.0, -n[b] / size, n[a] / size
        u[0] = n[1] * t[2] - n[2] * t[1]
        u[1] = n[2] * t[0] - n[0] * t[2]
        u[2] = n[0] * t[1] - n[1] * t[0]
        gt, gu = 0.0, 0.0
        for i in range(3):
            g[i] = delta[i] - p[i] - q[i]
            gt += g[i] * t[i]
            gu += g[i] * u[i]
        # −Hessian on the tangent plane: curvature of both supports, and f from the sphere's own
        tt, tu, uu = f, 0.0, f
        for which in range(2):
            shape = one if which == 0 else other
            w = p if which == 0 else q
            size = h if which == 0 else k
            wt = w[0] * t[0] + w[1] * t[1] + w[2] * t[2]
            wu = w[0] * u[0] + w[1] * u[1] + w[2] * u[2]
            dtt, dtu, duu = 0.0, 0.0, 0.0
            for i in range(3):
                for j in range(3):
                    dtt += t[i] * shape[i, j] * t[j]
                    dtu += t[i] * shape[i, j] * u[j]
                    duu += u[i] * shape[i, j] * u[j]
            tt += (dtt - wt * wt) / size
            tu += (dtu - wt * wu) / size
            uu += (duu - wu * wu) / size
        middle, half = 0.5 * (tt + uu), np.sqrt(0.25 * (tt - uu) ** 2 + tu * tu)
        least = 1e-2 * (h + k)
        if middle - half < least:  # not a hilltop here: make it one
            lift = least - (middle - half)
            tt += lift
            uu += lift
        det = tt * uu - tu * tu
        st, su = (uu * gt - tu * gu) / det, (tt * gu - tu * gt) / det
        length = np.sqrt(st * st + su * su)
        if length > 0.7:
            st, su, length = 0.7 * st / length, 0.7 * su / length, 0.7
        better = False
        for _ in range(12):
            size = np.sqrt(1.0 + st * st + su * su)
            for i in range(3):
                trial[i] = (n[i] + st * t[i] + su * u[i]) / size
            there, h, k = _gap(delta, one, other, trial, p, q)
            if there >= f:
                better = True
                break
            st, su = 0.25 * st, 0.25 * su
            if st * st + su * su < _DONE:
                break
        if not better:
            break
        done = st * st + su * su < _DONE
        f = there
        for i in range(3):
            n[i] = trial[i]
        if done:
            break
    f, h, k = _gap(delta, one, other, n, p, q)
    return f


@compiled_as_numpy
def separation(delta, one, other, enough, n, p, q):  # pragma: no cover - compiled
    """Return the signed distance of two ellipsoids (minus how far one must move) if it is below
    `enough` ≤ 0, else something above that.

    Parameters
    ----------
    delta
        From one's centre to the other's.
    n
        Direction in which they are to be parted.
    p, q
        The points that go deepest, from either centre.
    """
    size = np.sqrt(delta[0] ** 2 + delta[1] ** 2 + delta[2] ** 2)
    for a in range(3):
        n[a] = delta[a] / size if size > 1e-12 else 1.0 * (a == 0)
    f = _gap(delta, one, other, n, p, q)[0]
    if f > enough:  # so are most: nothing is allocated before
        return f
    # a second start: the normal, on the line of centres, of the ellipsoid with D₁ + D₂; better than that line for long parts.
    # That is (D₁ + D₂)⁻¹ δ, up to its length
    start, both = np.empty((2, 3)), one + other
    start[0] = n
    start[1] = np.cross(both[1], both[2]) * delta[0]
    start[1] += np.cross(both[2], both[0]) * delta[1]
    start[1] += np.cross(both[0], both[1]) * delta[2]
    size = np.sqrt((start[1] ** 2).sum())
    starts = 2 if size > 1e-300 else 1
    if starts == 2:
        start[1] /= size
        f = _gap(delta, one, other, start[1], p, q)[0]
        if f > enough:
            return f
    best, trial, tp, tq = -np.inf, np.empty(3), np.empty(3), np.empty(3)
    for s in range(starts):
        trial[:] = start[s]
        f = _climb(delta, one, other, trial, tp, tq)
        if f > best:
            best = f
            n[:], p[:], q[:] = trial, tp, tq
        if best > enough:
            return best
    # deep or symmetric overlaps have other ways out
    promising = best
    for way in _WAYS:
        f = _gap(delta, one, other, way, tp, tq)[0]
        if f > promising:
            promising = f
            trial[:] = way
    if promising > best:
        best = _climb(delta, one, other, trial, p, q)
        n[:] = trial
    return best


@compiled_as_numpy
def overlaps(place, shape, reach, first, second, found):  # pragma: no cover - compiled
    """Fill found (K,) with the signed distance of each pair where they overlap, 0 where they do not."""
    delta, n, p, q = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(first.shape[0]):
        i, j = first[k], second[k]
        far, square = reach[i] + reach[j], 0.0
        for a in range(3):
            delta[a] = place[j, a] - place[i, a]
            square += delta[a] ** 2
        found[k] = 0.0
        if square < far * far:
            found[k] = min(separation(delta, shape[i], shape[j], 0.0, n, p, q), 0.0)


@compiled_as_numpy
def collision_sums(frames, collisions, sums):  # pragma: no cover - compiled
    """Add the pairs' overlaps to sums; return ½ Σ r². collisions: as `CollisionTerm.collisions`."""
    ellipsoids, first, second, slack, sigma = collisions
    (bone, _, _, radii), reference = ellipsoids, frames.reference
    width, gradient, hessian = sums
    count = bone.shape[0]
    place, shape, reach = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty(count)
    posed_shapes(frames, ellipsoids, place, shape)
    for e in range(count):
        reach[e] = max(radii[e, 0], radii[e, 1], radii[e, 2])
    delta, n, p, q = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    row = np.empty(24)
    cost = 0.0
    for k in range(first.shape[0]):
        i, j = first[k], second[k]
        far, square = reach[i] + reach[j] - slack, 0.0
        for a in range(3):
            delta[a] = place[j, a] - place[i, a]
            square += delta[a] ** 2
        if far <= 0.0 or square >= far * far:
            continue
        distance = separation(delta, shape[i], shape[j], -slack, n, p, q)
        residual = (-distance - slack) / sigma
        if residual <= 0.0:
            continue
        cost += residual * residual
        if width == 0:
            continue
        # −d = n·(x_i − x_j) at the points that go deepest: + on i's bone, − on j's
        for side in range(2):
            e = i if side == 0 else j
            sign = (1.0 if side == 0 else -1.0) / sigma
            x = place[e, 0] - reference[0] + (p[0] if side == 0 else -q[0])
            y = place[e, 1] - reference[1] + (p[1] if side == 0 else -q[1])
            z = place[e, 2] - reference[2] + (p[2] if side == 0 else -q[2])
            at = width * side
            row[at], row[at + 1], row[at + 2] = n[0], n[1], n[2]
            fill_arm(row, at, width, x, y, z)
            for a in range(at, at + width):
                row[a] *= sign
        for a in range(2 * width):
            column = width * bone[i] + a if a < width else width * bone[j] + a - width
            gradient[column] += row[a] * residual
            for b in range(2 * width):
                other = width * bone[i] + b if b < width else width * bone[j] + b - width
                hessian[column, other] += row[a] * row[b]
    return 0.5 * cost
