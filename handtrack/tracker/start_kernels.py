"""Compiled scores of rigid shapes laid everywhere. The plain forms: tests/tracker/start_reference.py."""

from __future__ import annotations

import numba
import numpy as np

FAR_M = 0.025
"""from which a point counts as not explained at all"""
_CELLS, _CELL_M, _STEP_M = 64, 0.010, 0.020
"""of the picture in which a shape hides parts of itself"""
_GRAZING = 0.25


@numba.njit(cache=True, nogil=True, error_model="numpy")
def mark_visible(points, normals, turn, sight, picture, marks):  # pragma: no cover - compiled
    """Set marks (V,) to whether points (V, 3), turned, are seen from far away along `sight` (3,), which points to the eye.

    picture: (64, 64) scratch.
    """
    # a frame of the picture: two directions across the line of sight
    ax = 0
    if abs(sight[1]) < abs(sight[ax]):
        ax = 1
    if abs(sight[2]) < abs(sight[ax]):
        ax = 2
    e = np.zeros(3)
    e[ax] = 1.0
    x0 = sight[1] * e[2] - sight[2] * e[1]
    x1 = sight[2] * e[0] - sight[0] * e[2]
    x2 = sight[0] * e[1] - sight[1] * e[0]
    size = np.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
    x0, x1, x2 = x0 / size, x1 / size, x2 / size
    y0 = sight[1] * x2 - sight[2] * x1
    y1 = sight[2] * x0 - sight[0] * x2
    y2 = sight[0] * x1 - sight[1] * x0
    # into the shape's own frame
    s = np.empty(3)
    u = np.empty(3)
    v = np.empty(3)
    for j in range(3):
        s[j] = turn[0, j] * sight[0] + turn[1, j] * sight[1] + turn[2, j] * sight[2]
        u[j] = turn[0, j] * x0 + turn[1, j] * x1 + turn[2, j] * x2
        v[j] = turn[0, j] * y0 + turn[1, j] * y1 + turn[2, j] * y2
    picture[:] = -np.inf
    half = _CELLS // 2
    for n in range(points.shape[0]):
        a = points[n, 0] * u[0] + points[n, 1] * u[1] + points[n, 2] * u[2]
        b = points[n, 0] * v[0] + points[n, 1] * v[1] + points[n, 2] * v[2]
        d = points[n, 0] * s[0] + points[n, 1] * s[1] + points[n, 2] * s[2]
        i = min(max(int(np.floor(a / _CELL_M)) + half, 0), _CELLS - 1)
        k = min(max(int(np.floor(b / _CELL_M)) + half, 0), _CELLS - 1)
        picture[i, k] = max(picture[i, k], d)
    for n in range(points.shape[0]):
        facing = normals[n, 0] * s[0] + normals[n, 1] * s[1] + normals[n, 2] * s[2]
        if facing < _GRAZING:
            marks[n] = False
            continue
        a = points[n, 0] * u[0] + points[n, 1] * u[1] + points[n, 2] * u[2]
        b = points[n, 0] * v[0] + points[n, 1] * v[1] + points[n, 2] * v[2]
        d = points[n, 0] * s[0] + points[n, 1] * s[1] + points[n, 2] * s[2]
        i = min(max(int(np.floor(a / _CELL_M)) + half, 0), _CELLS - 1)
        k = min(max(int(np.floor(b / _CELL_M)) + half, 0), _CELLS - 1)
        marks[n] = d > picture[i, k] - _STEP_M


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cloud_scores(
    cloud, cloud_area, distances, map_low, map_spacing, sights, sight_start, rotations, places, middle, reach, field,
    field_low, field_spacing, points, normals, point_area, out,
):  # fmt: skip  # pragma: no cover - compiled
    """Fill out (R, M) with the share of area on which a shape and a cloud (N, 3) disagree, 0 to 1.

    Disagreement is the cloud's area within reach of the palm's middle that is not on the shape, and the shape's visible area
    that has no cloud. sights: (K, 3) directions to the eyes, one view being sights[sight_start[i]:sight_start[i + 1]]:
    all of its eyes must see a point, one view is enough; without views everything is visible.
    """
    views = sight_start.shape[0] - 1
    count = points.shape[0]
    picture = np.empty((_CELLS, _CELLS))
    visible = np.empty(count, np.bool_)
    by_all = np.empty(count, np.bool_)
    by_one = np.empty(count, np.bool_)
    turned = np.empty((count, 3))
    square = reach * reach
    for r in range(rotations.shape[0]):
        turn = rotations[r]
        visible[:] = views == 0
        for w in range(views):
            by_all[:] = True
            for e in range(sight_start[w], sight_start[w + 1]):
                mark_visible(points, normals, turn, sights[e], picture, by_one)
                for n in range(count):
                    by_all[n] = by_all[n] and by_one[n]
            for n in range(count):
                visible[n] = visible[n] or by_all[n]
        seen = 0
        for n in range(count):
            if visible[n]:
                x, y, z = points[n, 0] - middle[0], points[n, 1] - middle[1], points[n, 2] - middle[2]
                for i in range(3):
                    turned[seen, i] = turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z
                seen += 1
        for m in range(places.shape[0]):
            px, py, pz = places[m, 0], places[m, 1], places[m, 2]
            total, whole = 0.0, point_area * seen
            for n in range(cloud.shape[0]):
                x, y, z = cloud[n, 0] - px, cloud[n, 1] - py, cloud[n, 2] - pz
                if x * x + y * y + z * z > square:
                    continue
                a = turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z + middle[0] - field_low[0]
                b = turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z + middle[1] - field_low[1]
                c = turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z + middle[2] - field_low[2]
                total += cloud_area * _share(field, field_spacing, a, b, c)
                whole += cloud_area
            for n in range(seen):
                total += point_area * _share(
                    distances,
                    map_spacing,
                    turned[n, 0] + px - map_low[0],
                    turned[n, 1] + py - map_low[1],
                    turned[n, 2] + pz - map_low[2],
                )
            out[r, m] = total / max(whole, 1e-12)


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _share(values, spacing, x, y, z):  # pragma: no cover - compiled
    """Return how far the nearest node is from being explained: its squared distance in FAR_M, at most 1."""
    i, j, k = int(x / spacing + 0.5), int(y / spacing + 0.5), int(z / spacing + 0.5)
    if x < 0.0 or y < 0.0 or z < 0.0:
        return 1.0
    if i >= values.shape[0] or j >= values.shape[1] or k >= values.shape[2]:
        return 1.0
    share = min(values[i, j, k] / FAR_M, 1.0)
    return share * share
