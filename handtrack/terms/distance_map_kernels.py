"""Compiled: which filled cell of a grid is nearest to each of its cells, look-ups in such a map of distances, and the sums of E2.

The nearest filled cell along x, then along y of those, then along z (the transform is separable). In the last two steps, cells
1, 2, 3 … further are tried until none can be nearer: 16 at once. The plain form: tests/terms/test_cloud_terms.py.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types

from handtrack.compiled import compiled_as_numpy, inlined
from handtrack.terms.bone_kernels import add_row, fill_arm, to_world
from handtrack.terms.lanes_kernels import Eight, written
from handtrack.terms.loss import robust

_NOWHERE = 1e30
_LANES = 16
"""cells looked at together; rows are filled up to a multiple of it"""
_FLOATS, _INTS = ir.VectorType(ir.FloatType(), _LANES), ir.VectorType(ir.IntType(32), _LANES)


@written(types.void)
def _nearest(code, to, of, within, steps, least):
    """best[at:] = the least of far[row ± s · stride:] + s² over start ≤ s < stop, who[at:] = whose that is: 16 cells.

    to: best, who, at. of: far, whose, row, stride. Rows are sought `within` row + low · stride to row + high · stride; what
    lies beyond is taken to be as the last. Ends where nothing can be less, far being nowhere less than `least`. Of equals the
    first counts, so that the order is no matter.
    """
    builder = code.builder
    (far, whose, row, stride), (low, high), (start, stop) = of, within, steps
    best = cgutils.alloca_once_value(builder, ir.Constant(_FLOATS, [_NOWHERE] * _LANES))
    who = cgutils.alloca_once_value(builder, ir.Constant(_INTS, [0] * _LANES))
    with cgutils.for_range(builder, stop, start) as loop:
        s = loop.index
        square = builder.sitofp(builder.mul(s, s), ir.FloatType())
        for shift, better in ((builder.neg(s), "<="), (s, "<")):
            shift = builder.select(builder.icmp_signed("<", shift, low), low, shift)
            shift = builder.select(builder.icmp_signed(">", shift, high), high, shift)
            place = code.plus(row, code.times(shift, stride))
            distance = far.load(place, kind=_FLOATS).value
            distance = builder.fadd(distance, code.splat(square, _LANES).value)
            before = builder.load(best)
            nearer = builder.fcmp_ordered(better, distance, before)
            builder.store(builder.select(nearer, distance, before), best)
            owner = whose.load(place, kind=_INTS).value
            builder.store(builder.select(nearer, owner, builder.load(who)), who)
        limit = code.splat(builder.fadd(square, least), _LANES).value
        further = builder.fcmp_ordered(">", builder.load(best), limit)
        bits = ir.IntType(_LANES)
        with builder.if_then(builder.icmp_unsigned("==", builder.bitcast(further, bits), bits(0))):
            loop.do_break()
    for memory, found in zip(to, (best, who), strict=False):
        memory.store(Eight(builder, builder.load(found)), to[2])


@compiled_as_numpy
def fill_cells(points, low, spacing, cells):  # pragma: no cover - compiled
    """Fill cells (X, Y, Z) with each filled cell's own number, −1 where it is empty; return the points (N, 3) by cell, and
    first (XYZ + 1,): the points of cell m are those from first[m] to first[m + 1].

    points (N, 3) lie inside the grid. A cell's number is its place in the flat grid.
    """
    room, size = points.shape[0], cells.size
    first, cell = np.zeros(size + 1, np.int32), np.empty(room, np.int64)
    for n in range(room):
        i = np.int64(np.rint((points[n, 0] - low[0]) / spacing))
        j = np.int64(np.rint((points[n, 1] - low[1]) / spacing))
        k = np.int64(np.rint((points[n, 2] - low[2]) / spacing))
        cell[n] = (i * cells.shape[1] + j) * cells.shape[2] + k
        first[cell[n] + 1] += 1
    flat = cells.reshape(-1)
    for m in range(size):
        flat[m] = m if first[m + 1] > 0 else -1
        first[m + 1] += first[m]
    filled, ordered = first.copy(), np.empty((room, 3))
    for n in range(room):
        at = filled[cell[n]]
        filled[cell[n]] += 1
        for axis in range(3):
            ordered[at, axis] = points[n, axis]
    return ordered, first


@compiled_as_numpy
def fill_nearest(cells, nearest):  # pragma: no cover - compiled
    """Fill nearest (X, Y, Z), int32, with the number of the filled cell that is nearest to each cell. cells: as of `fill_cells`."""
    size_x, size_y, size_z = cells.shape
    lows, highs = np.array(cells.shape), np.full(3, -1)
    for i in range(size_x):
        for j in range(size_y):
            for k in range(size_z):
                if cells[i, j, k] >= 0:
                    lows[0], highs[0] = min(lows[0], i), max(highs[0], i)
                    lows[1], highs[1] = min(lows[1], j), max(highs[1], j)
                    lows[2], highs[2] = min(lows[2], k), max(highs[2], k)
    first, last = lows[1], highs[1] + 1
    begin, wide = lows[2], highs[2] + 1 - lows[2]
    room = (wide + _LANES - 1) // _LANES * _LANES
    far = np.zeros((size_x, last - first, room), np.float32)  # what fills rows up is soon found
    whose = np.zeros(far.shape, np.int32)
    _along_x(cells[:, first:last, begin : begin + wide], far, whose)
    long = (size_z + _LANES - 1) // _LANES * _LANES
    # beyond the row's ends there is nothing, as far as anybody looks
    row, owner = np.empty(3 * long + room, np.float32), np.zeros(3 * long + room, np.int32)
    best, who = np.empty(long, np.float32), np.empty(long, np.int32)
    row[:] = _NOWHERE
    for i in range(size_x):
        plane, near = i * (last - first) * room, _least(far[i], wide)
        for j in range(size_y):
            start = max(first - j, j - (last - 1), 0)
            at = plane + (j - first) * room
            for n in range(0, room, _LANES):
                to, of = (row, owner, long + begin + n), (far, whose, at + n, room)
                _nearest(to, of, (first - j, last - 1 - j), (start, size_y), near)
            row[long + begin + wide : long + begin + room] = _NOWHERE
            least = _least(row[long + begin :].reshape(1, -1), wide)
            for n in range(0, long, _LANES):
                _nearest((best, who, n), (row, owner, long + n, 1), (-long, long), (0, long), least)
            for k in range(size_z):
                nearest[i, j, k] = who[k]


@compiled_as_numpy
def _least(far, wide):  # pragma: no cover - compiled
    """Return the least of far[:, :wide]."""
    least = np.float32(_NOWHERE)
    for j in range(far.shape[0]):
        for k in range(wide):
            least = min(least, far[j, k])
    return least


@compiled_as_numpy
def _along_x(cells, far, whose):  # pragma: no cover - compiled
    """Fill far with the square of how many cells along x the nearest filled one is away, whose with its row."""
    last = far.shape[0] - 1
    for i in range(last + 1):
        for j in range(cells.shape[1]):
            for k in range(cells.shape[2]):
                m = cells[i, j, k]
                if m >= 0:
                    far[i, j, k], whose[i, j, k] = 0.0, m
                elif i > 0:
                    far[i, j, k], whose[i, j, k] = far[i - 1, j, k] + 1.0, whose[i - 1, j, k]
                else:
                    far[i, j, k], whose[i, j, k] = _NOWHERE, 0
    for i in range(last - 1, -1, -1):
        for j in range(cells.shape[1]):
            for k in range(cells.shape[2]):
                if far[i + 1, j, k] + 1.0 < far[i, j, k]:
                    far[i, j, k], whose[i, j, k] = far[i + 1, j, k] + 1.0, whose[i + 1, j, k]
    for i in range(last + 1):
        for j in range(cells.shape[1]):
            for k in range(cells.shape[2]):
                far[i, j, k] = min(far[i, j, k] * far[i, j, k], np.float32(_NOWHERE))


_AROUND = 2.0
"""[nodes apart]"""


@inlined
def _nearest_of(begin, end, points, x, y, z, least, best):  # pragma: no cover - compiled
    """Return the least square of a distance to points begin to end, or least, and whose it is."""
    for n in range(begin, end):
        dx, dy, dz = x - points[n, 0], y - points[n, 1], z - points[n, 2]
        square = dx * dx + dy * dy + dz * dz
        if square < least:
            least, best = square, n
    return least, best


@inlined
def _reached(u, reach, size):  # pragma: no cover - compiled
    """Return which cells of `size` are within reach of u, half-open."""
    begin, end = np.int64(np.rint(u - reach)), np.int64(np.rint(u + reach)) + 1
    return min(max(begin, 0), size), min(max(end, 0), size)


@inlined
def _gap(u, i):  # pragma: no cover - compiled
    """Return the square of what is between u and the cell around i."""
    return max(abs(u - i) - 0.5, 0.0) ** 2


@compiled_as_numpy
def look_up(distances, at, enough, distance, gradient):  # pragma: no cover - compiled
    """Fill distance (N,) and gradient (N, 3) at places (N, 3): to the nearest of all points where that is within about `_AROUND`,
    further away to the nearest of those in the cells that are nearest to the 8 nodes around; to any that is at most `enough`
    away [m].

    Cells that follow one another along z have points that do: they are looked through at once.
    """
    nearest, first, points, low, spacing = distances
    size_x, size_y, size_z = nearest.shape
    place, whose = np.empty(at.shape), np.empty((at.shape[0], 2), np.int64)
    for n in range(
        at.shape[0]
    ):  # without branches: only so do all these divisions and look-ups overlap
        for axis in range(3):
            place[n, axis] = (at[n, axis] - low[axis]) / spacing
        i, j, k = _corner(place[n], nearest)
        u, v, w = place[n, 0], place[n, 1], place[n, 2]
        m = nearest[i + (u - i > 0.5), j + (v - j > 0.5), k + (w - k > 0.5)]
        whose[n, 0], whose[n, 1] = first[m], first[m + 1]
    for n in range(at.shape[0]):
        x, y, z = at[n, 0], at[n, 1], at[n, 2]
        u, v, w = place[n, 0], place[n, 1], place[n, 2]
        least, best = _nearest_of(whose[n, 0], whose[n, 1], points, x, y, z, np.inf, 0)
        if least >= (_AROUND * spacing) ** 2:
            i, j, k = _corner(place[n], nearest)
            before = whose[n, 0]
            for node in range(8):
                m = nearest[i + (node >> 2), j + (node >> 1 & 1), k + (node & 1)]
                if first[m] != before:  # neighbours often share theirs
                    least, best = _nearest_of(first[m], first[m + 1], points, x, y, z, least, best)
                before = first[m]
        reach = np.sqrt(least) / spacing
        if reach < _AROUND:
            begin, end = _reached(w, reach, size_z)
            for i in range(*_reached(u, reach, size_x)):
                for j in range(*_reached(v, reach, size_y)):
                    is_near = spacing**2 * (_gap(u, i) + _gap(v, j)) < least
                    if is_near and least > enough * enough:
                        row = (i * size_y + j) * size_z
                        least, best = _nearest_of(
                            first[row + begin], first[row + end], points, x, y, z, least, best
                        )
        distance[n] = np.sqrt(least)
        share = 1.0 / distance[n] if distance[n] > 0.0 else 0.0
        gradient[n, 0] = share * (x - points[best, 0])
        gradient[n, 1] = share * (y - points[best, 1])
        gradient[n, 2] = share * (z - points[best, 2])


@inlined
def _corner(place, nearest):  # pragma: no cover - compiled
    """Return the first of the 8 nodes around a place [nodes], or of those nearest to it beyond the grid."""
    i, j, k = np.floor(place[0]), np.floor(place[1]), np.floor(place[2])
    size_x, size_y, size_z = nearest.shape
    return (
        min(max(np.int64(i), 0), size_x - 2),
        min(max(np.int64(j), 0), size_y - 2),
        min(max(np.int64(k), 0), size_z - 2),
    )


@compiled_as_numpy
def emptiness_sums(distances, frames, surface, noise, sums):  # pragma: no cover - compiled
    """Add E2 to sums; return ½ weight Σ share ρ.

    Parameters
    ----------
    surface
        Bone (V,), point in its frame (V, 3) and share (V,), which falls with the square of its
        bone's growth.
    noise
        Slack and σ [m], loss and weight.
    """
    bone, local, share = surface
    slack, sigma, loss, weight = noise
    reference, width = frames.reference, sums.width
    cost, row = 0.0, np.empty(12)
    points, distance = np.empty(local.shape), np.empty(bone.shape[0])
    gradient = np.empty(local.shape)
    for n in range(bone.shape[0]):
        to_world(frames, bone[n], local[n], points[n])
    look_up(distances, points, slack, distance, gradient)
    for n in range(bone.shape[0]):
        b, residual = bone[n], (distance[n] - slack) / sigma
        if residual <= 0.0:
            continue
        value, size = robust(loss, residual * residual)
        cost += value * share[n]
        if width == 0:
            continue
        for i in range(3):
            row[i] = gradient[n, i] / sigma
        x, y, z = (
            points[n, 0] - reference[0],
            points[n, 1] - reference[1],
            points[n, 2] - reference[2],
        )
        fill_arm(row, 0, width, x, y, z)
        if width == 12:  # the share falls as the patch grows
            for i in range(3, 12, 4):
                sums.gradient[width * b + i] -= weight * share[n] * value / 3.0
        add_row(sums, b, row, residual, weight * share[n] * size)
    return 0.5 * weight * cost


# ---- What a camera can see of a surface's points; a coarse picture in which points hide each other


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
