"""Compiled distance to the merged surface. The plain form: tests/model/metaballs_reference.py."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy, inlined

CENTRE, AXES, LEAST, REACH, STRETCH = 0, 3, 12, 13, 14
"""Columns of the table of an ellipsoid: centre (3); diag(1/r) Rᵀ (9, row by row), which makes it the unit ball; r_min;
r_max; a bound on |∇d|."""
TINY = 1e-9
"""Level k below which a point counts as the centre, where directions are undefined."""


BLOCK = 64
"""points that are looked at together"""
NOTHING = 40.0
"""e to minus so much is nothing beside 1"""


@compiled_as_numpy
def pose_table(frames, ellipsoids, table):  # pragma: no cover - compiled
    """Fill table (E, 16) with the ellipsoids where the bones have carried them."""
    rotation, position = frames.rotation, frames.position
    bone, centre, turn, radii = ellipsoids
    for e in range(bone.shape[0]):
        b = bone[e]
        for i in range(3):
            table[e, CENTRE + i] = position[b, i]
            for j in range(3):
                table[e, CENTRE + i] += rotation[b, i, j] * centre[e, j]
                axis = 0.0
                for k in range(3):
                    axis += rotation[b, j, k] * turn[e, k, i]
                table[e, AXES + 3 * i + j] = axis / radii[e, i]
        least = min(radii[e, 0], radii[e, 1], radii[e, 2])
        most = max(radii[e, 0], radii[e, 1], radii[e, 2])
        table[e, LEAST], table[e, REACH] = least, most
        # at the surface |∇d2| ≤ (r_max/r_min + r_min/r_max)/2 (Kantorovich); farther out it tends to 1, inside it is ≤ 1
        table[e, STRETCH] = 0.5 * (most / least + least / most)
        table[e, 15] = 0.0


@inlined
def in_unit_ball(table, e, x, y, z):  # pragma: no cover - compiled
    """Return a vector where ellipsoid e is the unit ball."""
    return (
        table[e, 3] * x + table[e, 4] * y + table[e, 5] * z,
        table[e, 6] * x + table[e, 7] * y + table[e, 8] * z,
        table[e, 9] * x + table[e, 10] * y + table[e, 11] * z,
    )


@inlined
def ellipsoid_gradient(table, e, turning, x, y, z):  # pragma: no cover - compiled
    """Return the distance d of a point to ellipsoid e, (k − 1) r_min where k < turning, else ρ (1 − 1/k), and its gradient."""
    x, y, z = x - table[e, 0], y - table[e, 1], z - table[e, 2]
    u, v, w = in_unit_ball(table, e, x, y, z)
    gx = table[e, 3] * u + table[e, 6] * v + table[e, 9] * w
    gy = table[e, 4] * u + table[e, 7] * v + table[e, 10] * w
    gz = table[e, 5] * u + table[e, 8] * v + table[e, 11] * w
    k = max(np.sqrt(u * u + v * v + w * w), TINY)
    if k < turning or k <= TINY:
        a = table[e, LEAST] / k
        return (k - 1.0) * table[e, LEAST], a * gx, a * gy, a * gz
    rho = np.sqrt(x * x + y * y + z * z)
    a, b = rho / (k * k * k), (1.0 - 1.0 / k) / rho
    return rho * (1.0 - 1.0 / k), a * gx + b * x, a * gy + b * y, a * gz + b * z


@inlined
def ellipsoid_distance(table, e, turning, x, y, z):  # pragma: no cover - compiled
    """Return d alone: what only the gradient needs is not compiled."""
    return ellipsoid_gradient(table, e, turning, x, y, z)[0]


@compiled_as_numpy
def merged_distance(
    points, surface, want_gradient, distance, closest, gradient
):  # pragma: no cover - compiled
    """Fill distance (N,), closest (N,) and, if wanted, gradient (N, 3) of the merged surface at points (N, 3)."""
    table, _, start, members, sharpness, turning = surface
    place, each = np.empty((3, BLOCK)), np.empty((table.shape[0], BLOCK))
    least, who = np.empty(BLOCK), np.empty(BLOCK, np.int64)
    for first in range(0, points.shape[0], BLOCK):
        count = min(BLOCK, points.shape[0] - first)
        for i in range(count):
            for axis in range(3):
                place[axis, i] = points[first + i, axis]
        least[:], who[:] = np.inf, 0
        for e in range(table.shape[0]):
            _fill_distances(table, e, turning, place, each[e])
            for i in range(BLOCK):
                who[i] = e if each[e, i] < least[i] else who[i]
                least[i] = each[e, i] if each[e, i] < least[i] else least[i]
        for i in range(count):
            n, best = first + i, who[i]
            total, gx, gy, gz = 0.0, 0.0, 0.0, 0.0
            for m in range(start[best], start[best + 1]):
                e = members[m]
                further = sharpness * (each[e, i] - least[i])
                if further > NOTHING and not want_gradient:
                    continue
                share = np.exp(-further)
                total += share
                if want_gradient:
                    _, nx, ny, nz = ellipsoid_gradient(
                        table, e, turning, place[0, i], place[1, i], place[2, i]
                    )
                    gx, gy, gz = gx + share * nx, gy + share * ny, gz + share * nz
            closest[n] = best
            distance[n] = each[best, i] - np.log(total) / sharpness
            if want_gradient:
                gradient[n, 0], gradient[n, 1], gradient[n, 2] = gx / total, gy / total, gz / total


@compiled_as_numpy
def _fill_distances(table, e, turning, place, found):  # pragma: no cover - compiled
    """Fill found (BLOCK,) with the distances of places (3, BLOCK) to an ellipsoid: a loop that is vectorised."""
    x, y, z = place[0], place[1], place[2]
    for i in range(BLOCK):
        found[i] = ellipsoid_distance(table, e, turning, x[i], y[i], z[i])
