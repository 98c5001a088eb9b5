"""Compiled: which filled cell of a grid is nearest to each of its cells, exact.

The nearest filled cell along x, then along y of those, then along z (the transform is separable). In the last two steps, cells
1, 2, 3 … further are tried until none can be nearer: 16 at once. The plain form: tests/terms/test_cloud_terms.py.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from handtrack.compiled import compiled_as_numpy

_NOWHERE = 1e30
_LANES = 16
"""cells looked at together; rows are filled up to a multiple of it"""
_FLOATS, _INTS = ir.VectorType(ir.FloatType(), _LANES), ir.VectorType(ir.IntType(32), _LANES)


def _place(context, builder, kind, array, index, vector):
    """Return the address of a flat element, as a pointer to `vector`."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def _splat(builder, number):
    one = builder.insert_element(ir.Constant(_FLOATS, ir.Undefined), number, ir.IntType(32)(0))
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), _LANES), [0] * _LANES)
    return builder.shuffle_vector(one, one, lanes)


@intrinsic
def _nearest(typing, best, who, at, far, whose, row, stride, low, high, start, stop, least):
    """best[at:] = the least of far[row ± s · stride:] + s² over start ≤ s < stop, who[at:] = whose that is: 16 cells.

    Rows are sought from row + low · stride to row + high · stride; what lies beyond is taken to be as the last. Ends where
    nothing can be less, far being nowhere less than `least`. Of equals the first counts, so that the order is no matter.
    """
    signature = types.void(best, who, at, far, whose, row, stride, low, high, start, stop, least)

    def generate(context, builder, signature, values):
        kinds = signature.args
        here, step, lowest, highest, start, stop, least = values[5:]
        best = cgutils.alloca_once_value(builder, ir.Constant(_FLOATS, [_NOWHERE] * _LANES))
        who = cgutils.alloca_once_value(builder, ir.Constant(_INTS, [0] * _LANES))
        with cgutils.for_range(builder, stop, start) as loop:
            s = loop.index
            square = builder.sitofp(builder.mul(s, s), ir.FloatType())
            more = _splat(builder, square)
            for shift, better in ((builder.neg(s), "<="), (s, "<")):
                shift = builder.select(builder.icmp_signed("<", shift, lowest), lowest, shift)
                shift = builder.select(builder.icmp_signed(">", shift, highest), highest, shift)
                place = builder.add(here, builder.mul(shift, step))
                distance, owner = (
                    builder.load(
                        _place(context, builder, kinds[n], values[n], place, vector), align=4
                    )
                    for n, vector in ((3, _FLOATS), (4, _INTS))
                )
                distance, before = builder.fadd(distance, more), builder.load(best)
                nearer = builder.fcmp_ordered(better, distance, before)
                builder.store(builder.select(nearer, distance, before), best)
                builder.store(builder.select(nearer, owner, builder.load(who)), who)
            limit = _splat(builder, builder.fadd(square, least))
            further = builder.fcmp_ordered(">", builder.load(best), limit)
            none = builder.icmp_unsigned(
                "==", builder.bitcast(further, ir.IntType(_LANES)), ir.IntType(_LANES)(0)
            )
            with builder.if_then(none):
                loop.do_break()
        for n, found, vector in ((0, best, _FLOATS), (1, who, _INTS)):
            to = _place(context, builder, kinds[n], values[n], values[2], vector)
            builder.store(builder.load(found), to, align=4)

    return signature, generate


@compiled_as_numpy
def fill_cells(points, low, spacing, cells):  # pragma: no cover - compiled
    """Fill cells (X, Y, Z) with the number of each filled cell, −1 where it is empty; return the points (N, 3) by cell, and
    first (M + 1,): the points of cell m are those from first[m] to first[m + 1].

    points (N, 3) lie inside the grid.
    """
    count, room = 0, points.shape[0]
    first, cell = np.zeros(room + 1, np.int32), np.empty(room, np.int32)
    cells[:] = -1
    for n in range(room):
        i = np.int64(np.rint((points[n, 0] - low[0]) / spacing))
        j = np.int64(np.rint((points[n, 1] - low[1]) / spacing))
        k = np.int64(np.rint((points[n, 2] - low[2]) / spacing))
        if cells[i, j, k] < 0:
            cells[i, j, k] = count
            count += 1
        cell[n] = cells[i, j, k]
        first[cell[n] + 1] += 1
    first = np.cumsum(first[: count + 1]).astype(np.int32)
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
                _nearest(
                    row, owner, long + begin + n, far, whose, at + n, room, first - j, last - 1 - j, start, size_y, near
                )  # fmt: skip
            row[long + begin + wide : long + begin + room] = _NOWHERE
            least = _least(row[long + begin :].reshape(1, -1), wide)
            for n in range(0, long, _LANES):
                _nearest(best, who, n, row, owner, long + n, 1, -long, long, 0, long, least)
            for k in range(size_z):
                nearest[i, j, k] = who[k] if cells[i, j, k] >= 0 else -1 - who[k]


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
