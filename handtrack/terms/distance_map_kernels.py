"""Compiled: which filled cell of a grid is nearest to each of its cells, look-ups in such a map of distances, and the sums of E2.

The nearest filled cell along x, then along y of those, then along z (the transform is separable). The plain form: tests/terms/test_cloud_terms.py.
"""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy, inlined
from handtrack.terms.bone_kernels import add_row, fill_arm, to_world
from handtrack.terms.loss import robust


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
    far = np.zeros(cells.shape, np.float32)  # squares of distances, exact up to 4096 cells
    nearest[:] = cells
    _nearest_in_rows(far.transpose(1, 2, 0), nearest.transpose(1, 2, 0))
    _nearest_in_rows(far.transpose(0, 2, 1), nearest.transpose(0, 2, 1))
    _nearest_in_rows(far, nearest)


@compiled_as_numpy
def _nearest_in_rows(far, nearest):  # pragma: no cover - compiled
    """Of each row along the last axis, exchange the square of how far each cell's filled one is, and its number, for those of the
    least far + (cells in between)² in the row, of equal ones the first; a number below 0 is none.

    These are parabolas, each the lowest from some cell on: the lower envelope of Felzenszwalb and Huttenlocher (2012).
    """
    size = far.shape[2]
    middle, begin = np.empty(size, np.int64), np.empty(size, np.int64)
    height, owner = np.empty(size), np.empty(size, nearest.dtype)
    for i in range(far.shape[0]):
        for j in range(far.shape[1]):
            count = 0
            for k in range(size):
                height[k], owner[k] = far[i, j, k], nearest[i, j, k]
                if owner[k] < 0:
                    continue
                first = 0
                while count > 0:
                    m = middle[count - 1]
                    meet = 0.5 * ((height[k] - height[m]) / (k - m) + k + m)
                    first = np.int64(np.floor(meet)) + 1
                    if first > begin[count - 1]:
                        break
                    count, first = count - 1, 0
                middle[count], begin[count] = k, first
                count += 1
            n = 0
            for k in range(size if count > 0 else 0):
                while n + 1 < count and begin[n + 1] <= k:
                    n += 1
                m = middle[n]
                far[i, j, k], nearest[i, j, k] = height[m] + (k - m) ** 2, owner[m]


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
    axes[0] = np.cross(axes[2], axes[1])
    axes[0] /= np.sqrt((axes[0] ** 2).sum())
    axes[1] = np.cross(axes[2], axes[0])
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
