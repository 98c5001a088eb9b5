"""Compiled look-ups in a distance map, and the sums of E2."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handtrack.arrays import D3, Array, Floats, M, N, X, Y, Z
from handtrack.compiled import compiled_as_numpy, inlined
from handtrack.terms.bone_kernels import add_row, fill_arm, to_world
from handtrack.terms.loss import robust


class MapArrays(NamedTuple):
    """A distance map as compiled code takes it; see `DistanceMap`."""

    nearest: Array[X, Y, Z]
    first: Array[M]
    points: Floats[N, D3]
    low: Floats[D3]
    spacing: float


_AROUND = 2.0
"""[nodes apart]"""


@inlined
def _nearest_in(m, first, points, x, y, z, least, best):  # pragma: no cover - compiled
    """Return the least square of a distance to the points of cell m, or least, and whose it is."""
    m = max(m, -1 - m)
    for n in range(first[m], first[m + 1]):
        dx, dy, dz = x - points[n, 0], y - points[n, 1], z - points[n, 2]
        square = dx * dx + dy * dy + dz * dz
        if square < least:
            least, best = square, n
    return least, best


@inlined
def _gap(u, i):  # pragma: no cover - compiled
    """Return the square of what is between u and the cell around i."""
    return max(abs(u - i) - 0.5, 0.0) ** 2


@compiled_as_numpy
def look_up(distances, x, y, z, enough):  # pragma: no cover - compiled
    """Return distance and gradient (3) at a point: to the nearest of all points where that is within about `_AROUND`, further
    away to the nearest of those in the cells that are nearest to its 8 nodes; to any that is at most `enough` away [m].
    """
    nearest, first, points, low, spacing = distances
    u, v, w = (x - low[0]) / spacing, (y - low[1]) / spacing, (z - low[2]) / spacing
    size_x, size_y, size_z = nearest.shape
    i = min(max(np.int64(np.floor(u)), 0), size_x - 2)
    j = min(max(np.int64(np.floor(v)), 0), size_y - 2)
    k = min(max(np.int64(np.floor(w)), 0), size_z - 2)
    before = nearest[i + (u - i > 0.5), j + (v - j > 0.5), k + (w - k > 0.5)]
    least, best = _nearest_in(before, first, points, x, y, z, np.inf, 0)
    if least >= (_AROUND * spacing) ** 2:
        for node in range(8):
            m = nearest[i + (node >> 2), j + (node >> 1 & 1), k + (node & 1)]
            if m != before:  # neighbours often share theirs
                least, best = _nearest_in(m, first, points, x, y, z, least, best)
            before = m
    reach = np.sqrt(least) / spacing
    if reach < _AROUND and least > enough * enough:
        for i in range(
            max(np.int64(np.rint(u - reach)), 0), min(np.int64(np.rint(u + reach)) + 1, size_x)
        ):
            for j in range(
                max(np.int64(np.rint(v - reach)), 0), min(np.int64(np.rint(v + reach)) + 1, size_y)
            ):
                for k in range(
                    max(np.int64(np.rint(w - reach)), 0),
                    min(np.int64(np.rint(w + reach)) + 1, size_z),
                ):
                    m = nearest[i, j, k]
                    if m >= 0 and spacing**2 * (_gap(u, i) + _gap(v, j) + _gap(w, k)) < least:
                        least, best = _nearest_in(m, first, points, x, y, z, least, best)
    distance = np.sqrt(least)
    share = 1.0 / distance if distance > 0.0 else 0.0
    return (
        distance,
        share * (x - points[best, 0]),
        share * (y - points[best, 1]),
        share * (z - points[best, 2]),
    )


@compiled_as_numpy
def look_up_all(distances, at, distance, gradient):  # pragma: no cover - compiled
    """Fill distance (N,) and gradient (N, 3) at places (N, 3)."""
    for n in range(at.shape[0]):
        distance[n], gradient[n, 0], gradient[n, 1], gradient[n, 2] = look_up(
            distances, at[n, 0], at[n, 1], at[n, 2], 0.0
        )


@compiled_as_numpy
def fill_nodes(distances, values):  # pragma: no cover - compiled
    """Fill values (X, Y, Z), float32, with each node's distance."""
    low, spacing = distances.low, distances.spacing
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            for k in range(values.shape[2]):
                x, y, z = low[0] + spacing * i, low[1] + spacing * j, low[2] + spacing * k
                values[i, j, k] = look_up(distances, x, y, z, 0.0)[0]


@compiled_as_numpy
def emptiness_sums(distances, frames, surface, noise, sums):  # pragma: no cover - compiled
    """Add E2 to sums; return ½ weight Σ share ρ.

    surface: bone (V,), point in its frame (V, 3) and share (V,), which falls with the square of its bone's growth. noise: slack and
    σ [m], loss and weight.
    """
    bone, local, share = surface
    slack, sigma, loss, weight = noise
    reference, width = frames.reference, sums.width
    cost, row, point = 0.0, np.empty(12), np.empty(3)
    for n in range(bone.shape[0]):
        b = bone[n]
        to_world(frames, b, local[n], point)
        x, y, z = point[0], point[1], point[2]
        distance, gx, gy, gz = look_up(distances, x, y, z, slack)
        residual = (distance - slack) / sigma
        if residual <= 0.0:
            continue
        value, size = robust(loss, residual * residual)
        cost += value * share[n]
        if width == 0:
            continue
        x, y, z = x - reference[0], y - reference[1], z - reference[2]
        row[0], row[1], row[2] = gx / sigma, gy / sigma, gz / sigma
        fill_arm(row, 0, width, x, y, z)
        if width == 12:  # the share falls as the patch grows
            for i in range(3, 12, 4):
                sums.gradient[width * b + i] -= weight * share[n] * value / 3.0
        add_row(sums, b, row, residual, weight * share[n] * size)
    return 0.5 * weight * cost
