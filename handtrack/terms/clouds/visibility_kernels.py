"""Compiled: what a camera can see of a surface's points; a coarse picture in which points hide each other."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy

_NEAREST_M = 1e-3


@compiled_as_numpy
def fill_facing(points, normals, centre, least, facing):  # pragma: no cover - compiled
    """Fill facing (V,): whether the cosine between normal and viewing ray is above `least`."""
    for n in range(points.shape[0]):
        along, square = 0.0, 0.0
        for i in range(3):
            ray = centre[i] - points[n, i]
            along += normals[n, i] * ray
            square += ray * ray
        facing[n] = along > least * np.sqrt(square)


@compiled_as_numpy
def occlusion(points, others, centre, cell_m, step_m):  # pragma: no cover - compiled
    """Return which points (V, 3) have one of others (M, 3) before them, nearer to a camera's centre by step_m on about the same line of
    sight, and which of others lie so before any of points.
    """
    place, depth, cell, nearer, count = _picture(points, others, centre, cell_m)
    nearest, furthest = np.full(count + 1, np.inf), np.full(count + 1, -np.inf)
    for n in range(others.shape[0]):
        nearest[cell[n]] = min(nearest[cell[n]], nearer[n])
    for n in range(points.shape[0]):
        furthest[place[n]] = max(furthest[place[n]], depth[n])
    return depth > nearest[place] + step_m, nearer + step_m < furthest[cell]


@compiled_as_numpy
def _picture(points, others, centre, cell_m):  # pragma: no cover - compiled
    """Return cells and depths of points (V, 3) and of others (M, 3) in a picture of the points from a camera's centre, and its count of
    cells, which others beside the picture have for theirs. Cells are `cell_m` wide at the points' distance.
    """
    axes = np.zeros((3, 3))  # across, down and to the points' mean
    for n in range(points.shape[0]):
        for i in range(3):
            axes[2, i] += (points[n, i] - centre[i]) / points.shape[0]
    far = max(np.sqrt((axes[2] ** 2).sum()), 1e-6)
    axes[2] /= far
    axes[1, np.argmin(np.abs(axes[2]))] = 1.0
    _cross(axes[2], axes[1], axes[0])
    axes[0] /= np.sqrt((axes[0] ** 2).sum())
    _cross(axes[2], axes[0], axes[1])
    flat, depth = _seen(points, centre, axes, far / cell_m)
    beside, nearer = _seen(others, centre, axes, far / cell_m)
    left, top = flat[:, 0].min(), flat[:, 1].min()
    wide, high = np.floor(flat[:, 0].max() - left) + 1.0, np.floor(flat[:, 1].max() - top) + 1.0
    count = np.int64(wide * high)
    place, cell = np.empty(points.shape[0], np.int64), np.full(others.shape[0], count)
    for n in range(points.shape[0]):
        place[n] = np.int64(np.floor(flat[n, 0] - left) * high + np.floor(flat[n, 1] - top))
    for n in range(others.shape[0]):
        u, v = np.floor(beside[n, 0] - left), np.floor(beside[n, 1] - top)
        if nearer[n] > 0.0 and 0.0 <= u < wide and 0.0 <= v < high:
            cell[n] = np.int64(u * high + v)
    return place, depth, cell, nearer, count


@compiled_as_numpy
def _cross(a, b, out):  # pragma: no cover - compiled
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = a[j] * b[k] - a[k] * b[j]


@compiled_as_numpy
def _seen(points, centre, axes, scale):  # pragma: no cover - compiled
    """Return where points lie in the picture (N, 2), in cells, and their depths (N,) [m]."""
    flat, depth, seen = np.empty((points.shape[0], 2)), np.empty(points.shape[0]), np.empty(3)
    for n in range(points.shape[0]):
        for i in range(3):
            seen[i] = 0.0
            for j in range(3):
                seen[i] += axes[i, j] * (points[n, j] - centre[j])
        depth[n] = seen[2]
        for i in range(2):
            flat[n, i] = scale * seen[i] / max(seen[2], _NEAREST_M)
    return flat, depth
