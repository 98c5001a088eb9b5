"""Compiled scores of rigid shapes laid everywhere."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy, compiled_with, inlined
from handtrack.terms.clouds import GRAZING
from handtrack.terms.distance_map_kernels import fill_facing, occlusion

FAR_M = 0.025
"""from which a point counts as not explained at all"""
NEAREST_M = 0.02
"""before a camera; what is nearer is not looked at"""
OUT_OF_SIGHT = 0.5
"""how far off, in FAR_M, a point outside a camera's picture counts: a hand in full view is the likelier one"""
_CELL_M, _STEP_M = 0.010, 0.020
"""of the picture in which a shape hides parts of itself"""


@inlined
def _image(p, x, y, z):  # pragma: no cover - compiled
    """Return homogeneous pixels and the depth of a point, by a projection."""
    return (
        p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3],
        p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3],
        p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3],
    )


@inlined
def _fill_turned(turn, rows, n, middle, out, m):  # pragma: no cover - compiled
    """Fill out[m] with row n from a middle, turned."""
    x, y, z = rows[n, 0] - middle[0], rows[n, 1] - middle[1], rows[n, 2] - middle[2]
    for i in range(3):
        out[m, i] = turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z


@inlined
def _back(turn, x, y, z):  # pragma: no cover - compiled
    """Return a vector, turned back."""
    return (
        turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z,
        turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z,
        turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z,
    )


@compiled_as_numpy
def cloud_scores(cloud, distances, eyes, laid, shape, field):  # pragma: no cover - compiled
    """Return (R, M) the share of area on which a shape and a cloud disagree, 0 to 1.

    Disagreement is the cloud's area within reach of the palm's middle that is not on the shape, and
    the shape's visible area that has no cloud.

    Parameters
    ----------
    cloud
        Points (N, 3) and the area of each.
    distances, field
        To cloud and shape, values on a grid, where it begins and its spacing.
    laid
        Rotations (R, 3, 3) and places (M, 3).
    shape
        Points, normals, the area of each point, the palm's middle, reach.
    eyes
        (K, 3) the ways to them from the cloud's middle, and where those of each view begin: all of
        its eyes must see a point, one view is enough; without views everything is visible.
    """
    (cloud, cloud_area), (distances, map_low, map_spacing) = cloud, distances
    (ways, sight_start), (rotations, places) = eyes, laid
    points, normals, point_area, middle, reach = shape
    field, field_low, field_spacing = field
    out = np.empty((rotations.shape[0], places.shape[0]))
    views = sight_start.shape[0] - 1
    count = points.shape[0]
    visible = np.empty(count, np.bool_)
    by_all = np.empty(count, np.bool_)
    by_one = np.empty(count, np.bool_)
    eye, turned = np.empty(3), np.empty((count, 3))
    square = reach * reach
    for r in range(rotations.shape[0]):
        turn = rotations[r]
        visible[:] = views == 0
        for w in range(views):
            by_all[:] = True
            for e in range(sight_start[w], sight_start[w + 1]):
                x, y, z = _back(turn, ways[e, 0], ways[e, 1], ways[e, 2])
                eye[0], eye[1], eye[2] = middle[0] + x, middle[1] + y, middle[2] + z
                fill_facing(points, normals, eye, GRAZING, by_one)
                by_all &= by_one & ~occlusion(points, points, eye, _CELL_M, _STEP_M)[0]
            visible |= by_all
        seen = 0
        for n in range(count):
            if visible[n]:
                _fill_turned(turn, points, n, middle, turned, seen)
                seen += 1
        for m in range(places.shape[0]):
            px, py, pz = places[m, 0], places[m, 1], places[m, 2]
            total, whole = 0.0, point_area * seen
            for n in range(cloud.shape[0]):
                x, y, z = cloud[n, 0] - px, cloud[n, 1] - py, cloud[n, 2] - pz
                if x * x + y * y + z * z > square:
                    continue
                a, b, c = _back(turn, x, y, z)
                total += cloud_area * _share(
                    field,
                    field_spacing,
                    a + middle[0] - field_low[0],
                    b + middle[1] - field_low[1],
                    c + middle[2] - field_low[2],
                )
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
    return out


@inlined
def _share(values, spacing, x, y, z):  # pragma: no cover - compiled
    """Return how far the nearest node is from being explained: its squared distance in FAR_M, at most 1."""
    i, j, k = int(x / spacing + 0.5), int(y / spacing + 0.5), int(z / spacing + 0.5)
    if x < 0.0 or y < 0.0 or z < 0.0:
        return 1.0
    if i >= values.shape[0] or j >= values.shape[1] or k >= values.shape[2]:
        return 1.0
    share = min(values[i, j, k] / FAR_M, 1.0)
    return share * share


@compiled_with(error_model="numpy", fastmath=True)
def _off_disc(across, down, count, u, v, radius, least):  # pragma: no cover - compiled
    """Lower least (count,) to how far pixels lie outside a disc; all float32."""
    for k in range(count):
        x, y = across[k] - u, down[k] - v
        off = np.sqrt(x * x + y * y) - radius
        least[k] = off if off < least[k] else least[k]


@compiled_as_numpy
def silhouette_scores(
    views, pictures, samples, laid, shape, spheres, enough
):  # pragma: no cover - compiled
    """Return (R, M) the share of area on which a shape's outlines and silhouettes disagree, 0 to 1.

    Disagreement is the mask's area within reach of the palm's middle that the shape does not cover,
    and the shape's area outside the mask, both summed over cameras at the hand's distance.

    Once the share is sure to be larger than `enough`, what it is at least is returned.

    Parameters
    ----------
    views
        Projections (C, 3, 4) and focal lengths.
    pictures
        (C, H, W) distance to the mask [px] on every `step`-th pixel, (C, 2) their columns and rows
        that count, and the step.
    samples
        Mask pixels, where those of each camera begin, and the area for which each stands [px²].
    laid, shape
        As `cloud_scores`.
    """
    (projections, focal), (outside, sizes, step) = views, pictures
    samples, sample_start, sample_area = samples
    (rotations, places), (points, normals, point_area, middle, reach) = laid, shape
    out = np.empty((rotations.shape[0], places.shape[0]))
    cameras, balls, count = projections.shape[0], spheres.shape[0], points.shape[0]
    turned, facing = np.empty((count, 3)), np.empty((count, 3))
    ball = np.empty((balls, 3))
    across, down, least = np.empty((3, samples.shape[0]), np.float32)
    for r in range(rotations.shape[0]):
        turn = rotations[r]
        for n in range(balls):
            _fill_turned(turn, spheres, n, middle, ball, n)
        for n in range(count):
            _fill_turned(turn, points, n, middle, turned, n)
            _fill_turned(turn, normals, n, (0.0, 0.0, 0.0), facing, n)
        for m in range(places.shape[0]):
            px, py, pz = places[m, 0], places[m, 1], places[m, 2]
            total, whole, most = 0.0, 0.0, 0.0
            for c in range(cameras):  # the shape's area outside the mask
                p = projections[c]
                depth = _image(p, px, py, pz)[2]
                if depth < NEAREST_M:
                    continue
                metre = depth / focal[c]
                most += (sample_start[c + 1] - sample_start[c]) * sample_area[c] * metre * metre
                for n in range(0, count, 2):  # every other point will do
                    toward = -(
                        p[2, 0] * facing[n, 0] + p[2, 1] * facing[n, 1] + p[2, 2] * facing[n, 2]
                    )
                    if toward <= 0.0:
                        continue
                    x, y, z = turned[n, 0] + px, turned[n, 1] + py, turned[n, 2] + pz
                    a, b, w = _image(p, x, y, z)
                    if w < NEAREST_M:
                        continue
                    u, v = a / (w * step), b / (w * step)
                    share = OUT_OF_SIGHT
                    if u >= -0.5 and v >= -0.5 and u < sizes[c, 0] - 0.5 and v < sizes[c, 1] - 0.5:
                        share = min(outside[c, int(v + 0.5), int(u + 0.5)] * metre / FAR_M, 1.0)
                    total += 2.0 * toward * point_area * share * share
                    whole += 2.0 * toward * point_area
            for c in range(cameras):  # the mask's area that the shape does not cover
                p = projections[c]
                a, b, depth = _image(p, px, py, pz)
                if depth < NEAREST_M:
                    continue
                if total > enough * (whole + most):
                    break
                u0, v0 = a / depth, b / depth
                metre = depth / focal[c]
                within = reach / metre
                within *= within
                near = 0
                for k in range(sample_start[c], sample_start[c + 1]):
                    u, v = samples[k, 0], samples[k, 1]
                    if (u - u0) * (u - u0) + (v - v0) * (v - v0) < within:
                        across[near], down[near], least[near] = u, v, 1e9
                        near += 1
                for n in range(balls):
                    x, y, z = ball[n, 0] + px, ball[n, 1] + py, ball[n, 2] + pz
                    a, b, w = _image(p, x, y, z)
                    w = max(w, NEAREST_M)
                    u, v = a / w, b / w
                    radius = spheres[n, 3] * focal[c] / w
                    _off_disc(
                        across, down, near, np.float32(u), np.float32(v), np.float32(radius), least
                    )
                area = sample_area[c] * metre * metre
                most -= (sample_start[c + 1] - sample_start[c]) * area
                for k in range(near):
                    share = min(max(least[k], 0.0) * metre / FAR_M, 1.0)
                    total += area * share * share
                    whole += area
            whole += max(most, 0.0)
            out[r, m] = total / whole if whole > 0.0 else 1.0
    return out
