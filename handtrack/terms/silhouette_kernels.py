"""Compiled loops of the silhouette terms: row by row, run by run. The plain form: tests/terms/conic_field_reference.py.

A field of an ellipse is a quadratic q(u, v), −1 at its centre, 0 on its outline; the term sees s·(q − t). Three ideas:

1. Every ellipse has its own origin, the whole pixel next to its centre. Sums of powers up to the fourth are then sums
   of small integers: exact, and without cancellation for ellipses of any size anywhere in the image.
2. A row keeps, per pixel, −value of the lowest field with the ellipse's number in the last bits of the float: one
   maximum finds value and winner.
3. Where the winner does not change from pixel to pixel, powers are summed by two look-ups, and so is the observation, which
   is kept as runs of one value.
"""

from __future__ import annotations

from functools import reduce
from typing import NamedTuple

import numpy as np
from numba.core import types

from handtrack.arrays import D2, D3, D4, D8, D24, Array, Bytes, E, Floats, H, Ints, K, L, M, N, X
from handtrack.compiled import compiled, compiled_as_numpy, inlined
from handtrack.model.kinematics import Frames
from handtrack.terms.bone_kernels import posed_shapes
from handtrack.terms.conic_kernels import (
    CENTRE_U,
    CENTRE_V,
    ELLIPSE,
    FIELD,
    ORIGIN_U,
    ORIGIN_V,
    S11,
    S12,
    S22,
    SCALE,
    conic_by_field,
    conic_by_twist,
    conic_of,
    project,
    room,
)
from handtrack.terms.lanes_kernels import Eight, written
from handtrack.terms.row_kernels import (
    BLOCK,
    MOMENTS,
    PADDING,
    SUMS,
    WORD,
    add_run,
    begin_row,
    find_runs,
    mark,
    move_sums,
    number_at,
    paint,
)
from handtrack.terms.term import Sums

MIDDLE_U, MIDDLE_V, SLANT, ACROSS, DOWN, ROOM, FACTOR, BEND = range(8)
"""Columns of `lines`: the ellipse's centre [px]; d middle / d row; half-width² per unit of room; room lost per row²;
room on the centre's row; factor; curvature of the value along the row."""
LINE = 8
SPANS = 6 * BLOCK
"""numbers of eight rows' spans, see `_fill_spans`"""
_SURELY = 1e-6  # [px] nearer to its end, rounding decides whether a pixel is saturated


class MaskArrays(NamedTuple):
    """An observation Z as pieces of one value, as compiled sums take it."""

    valid: Array[H, D2]
    """int32: per row the half-open column span that counts."""
    begins: Ints[L]
    """(H + 1,): the pieces of row v, in each of which Z has one value, are begins[v] to begins[v + 1]."""
    ends: Ints[K]
    """the column where each piece ends, and the next begins."""
    values: Floats[K]
    """Z; above 0 where nobody knows, which counts for nothing."""
    edges: Bytes[H, M]
    """(H, W // 8 + 1): a bit for each pixel at which a piece begins, but the first of a row."""
    powers: Floats[N, D8]
    """(2W + 1, 8): sums of x⁰ … x⁴, see `power_sums`."""
    heights: Floats[X, D24]
    """(2H + 1, 24): the powers of y that go with each sum, see `height_powers`."""


class CameraField(NamedTuple):
    """P in one camera: the least of s (q − t), at most 0 and at least −limit, over ellipsoids; q: −1 at the centre, 0 on the outline."""

    projection: Floats[D3, D4]
    levels: Floats[E, D2]
    """t and s of each ellipsoid"""
    limit: float
    """infinite for a field without a floor"""
    depth_scaled: bool
    """the paper's scale: s = −1/C*₃₃ [m⁻²] instead, which puts near ellipsoids before far ones"""
    step: int
    """of so many rows one is looked at, which stands for all"""


@compiled
def silhouette_sums(
    frames, ellipsoids, radii, mask, field, weight, sums
):  # pragma: no cover - compiled
    """Add one camera's ½ weight Σ (P − Z)² to sums; return the cost, without ½ weight ΣZ², which no
    pose changes.

    A width of FIELD: the twelve numbers of a field, and by how much the outline is farther out.
    Arguments are plain tuples of what they are called: to check classes of NamedTuples takes 10 %
    of the time.

    Parameters
    ----------
    ellipsoids
        As thick as this mask has them.
    radii
        As they are themselves, (E, 3).
    """
    frames, sums = Frames(*frames), Sums(*sums)
    mask, field = MaskArrays(*mask), CameraField(*field)
    bone, _, turn, thick = ellipsoids
    count = bone.shape[0]
    centre, shape = np.empty((count, 3)), np.empty((count, 3, 3))
    posed_shapes(frames, ellipsoids, centre, shape)
    shapes, image = (centre, shape, frames.reference), room()
    ellipses, moments = np.zeros((count + 2, ELLIPSE)), np.zeros((count + 2, MOMENTS))
    height, width = mask.valid.shape[0], (mask.powers.shape[0] - 1) // 2
    project(
        field.projection,
        (width, height),
        centre,
        shape,
        field.levels,
        field.depth_scaled,
        ellipses,
    )
    _sum_rows(ellipses, mask, field, moments)
    weight *= field.step
    core = count + 1
    cost = 0.5 * moments[core, 0] + moments[core, 16]
    m, z = np.zeros((6, 6)), np.zeros(6)
    c, mc = np.empty(6), np.empty(6)
    work, own, wide = np.zeros(168), np.empty((3, 3)), np.empty((3, 3))
    for e in range(count):
        if moments[e + 1, 0] == 0.0:
            continue
        _unpack(moments, e + 1, m, z)
        conic_of(ellipses, e, field.levels[e, 0], c)
        for i in range(6):
            mc[i] = 0.0
            for j in range(6):
                mc[i] += m[i, j] * c[j]
            cost += c[i] * (0.5 * mc[i] - z[i])
        if sums.width == 6:
            conic_by_twist(field, shapes, ellipses, e, image, work)
            _add_block(work, m, mc, z, weight, 6 * bone[e], sums)
        elif sums.width == FIELD:
            _fill_shapes(
                frames.rotation[bone[e]],
                turn[e],
                thick[e],
                radii[e],
                own,
                wide,
            )
            by = conic_by_field(field, shapes, ellipses, e, image, (own, wide), c)
            _add_field(by, m, mc, z, weight, bone[e], sums)
    return weight * cost


@compiled
def overlap_areas(
    frames, ellipsoids, projection, mask, starts, members, step, areas
):  # pragma: no cover - compiled
    """Fill areas (N, 2): pixels that each part covers, and −ΣZ over them, by one row of each `step`.

    Part n is the ellipsoids members[starts[n] : starts[n + 1]]. A field that is saturated wherever it is negative counts them.
    """
    count, height, width = (
        ellipsoids[0].shape[0],
        mask.valid.shape[0],
        (mask.powers.shape[0] - 1) // 2,
    )
    centre, shape = np.empty((count, 3)), np.empty((count, 3, 3))
    posed_shapes(frames, ellipsoids, centre, shape)
    ellipses, levels = np.zeros((count, ELLIPSE)), np.zeros((count, 2))
    levels[:, 1] = 1.0
    project(projection, (width, height), centre, shape, levels, False, ellipses)
    for part in range(starts.shape[0] - 1):
        own = ellipses[members[starts[part] : starts[part + 1]]]
        moments = np.zeros((own.shape[0] + 2, MOMENTS))
        field = CameraField(projection, levels[: own.shape[0]], 0.0, False, step)
        _sum_rows(own, mask, field, moments)
        areas[part, 0], areas[part, 1] = step * moments[:, 0].sum(), -step * moments[:, 16].sum()


@compiled
def _sum_rows(ellipses, mask, field, moments):  # pragma: no cover - compiled
    """Fill moments (E + 2, MOMENTS): of nobody, of each ellipse where it wins, of saturated pixels."""
    levels, limit, step = field.levels, field.limit, field.step
    valid, begins, ends, values = mask.valid, mask.begins, mask.ends, mask.values
    edges, powers, heights = mask.edges, mask.powers, mask.heights
    count, height, width = levels.shape[0], valid.shape[0], (powers.shape[0] - 1) // 2
    looked_at = (height - step // 2 + step - 1) // step  # rows step // 2, step // 2 + step, …
    lines, rows = np.empty((count, LINE)), np.zeros((count, 3), np.int64)
    newest, after = np.full(looked_at + 1, -1), np.empty(count, np.int64)  # who begins on a row
    room = 0
    for e in range(count):  # which of them each ellipse reaches
        if ellipses[e, SCALE] == 0.0:
            continue
        _row_line(ellipses, levels, e, lines)
        reach = np.sqrt((1.0 + levels[e, 0]) * ellipses[e, S22])
        middle = lines[e, MIDDLE_V] - step // 2
        first = np.int64(min(max(np.ceil((middle - reach) / step), 0.0), float(looked_at)))
        last = np.int64(min(max(np.floor((middle + reach) / step) + 1.0, 0.0), float(looked_at)))
        if first < last:
            rows[e, 0], rows[e, 1], rows[e, 2] = first, last, room
            room += (last - first + BLOCK - 1) // BLOCK * SPANS
            after[e], newest[first] = newest[first], e
    spans = np.empty(room)
    _fill_spans(lines, rows, limit, step, width, spans)
    origin_u, origin_v = np.full(count + 2, width), np.full(count + 2, height)  # as `moments`
    for e in range(count):
        origin_u[e + 1] -= np.int64(ellipses[e, ORIGIN_U])
        origin_v[e + 1] -= np.int64(ellipses[e, ORIGIN_V])
    memory = np.zeros(width + 2 * PADDING + BLOCK)
    buffer = memory[
        PADDING + (-memory.ctypes.data // 8) % BLOCK :
    ]  # blocks that straddle two cache lines cost more
    starts = np.empty(buffer.shape[0] + BLOCK, np.int64)
    words = width // (WORD * BLOCK) + 1
    marks, opened = np.zeros(words * BLOCK, np.int64), np.zeros(words, np.int64)
    sums = np.zeros((count + 2, SUMS))
    active, alive = np.empty(count, np.int64), 0
    painted = np.empty((count, 4), np.int64)
    core = count + 1
    for row in range(looked_at):
        e = newest[row]
        while e >= 0:
            active[alive] = e
            alive += 1
            e = after[e]
        v = step // 2 + step * row
        begin, end = np.int64(valid[v, 0]), np.int64(valid[v, 1])
        low, high, n, found = end, begin, 0, 0
        while n < alive:
            e = active[n]
            if row >= rows[e, 1]:
                alive -= 1
                active[n] = active[alive]
                continue
            n += 1
            below = row - rows[e, 0]
            at = rows[e, 2] + below // BLOCK * SPANS + below % BLOCK
            a, b = max(np.int64(spans[at + 16]), begin), min(np.int64(spans[at + 24]), end)
            if a >= b:
                continue
            low, high = min(low, a), max(high, b)
            painted[found, 0], painted[found, 1] = e, at
            painted[found, 2], painted[found, 3] = a, b
            found += 1
            mark(marks, max(np.int64(spans[at + 32]), begin), min(np.int64(spans[at + 40]), end))
        if low >= high:
            continue
        begin_row(buffer, low, high, marks, opened, core)
        for n in range(found):
            e, at = painted[n, 0], painted[n, 1]
            parabola = spans[at], spans[at + 8], lines[e, BEND]
            paint(buffer, (painted[n, 2], painted[n, 3]), opened, parabola, limit, e + 1, core)
        runs = find_runs(buffer, low, high, edges[v], starts)
        left, piece = low, begins[v]
        while ends[piece] <= low:
            piece += 1
        for n in range(runs):
            right = starts[n + 1]
            if values[piece] <= 0.0:  # above it, nobody knows
                k = number_at(buffer, left)
                add_run(sums, k, powers, left + origin_u[k], right + origin_u[k], values[piece])
            piece += np.int64(ends[piece] <= right)
            left = right
        for n in range(found):
            k = painted[n, 0] + 1
            move_sums(moments, sums, k, heights, v + origin_v[k])
        move_sums(moments, sums, core, heights, v + height)


@inlined
def _row_line(ellipses, levels, e, lines):  # pragma: no cover - compiled
    """Fill what an ellipse's span on a row needs: all divisions, once for all rows."""
    s11, s12, s22 = ellipses[e, S11], ellipses[e, S12], ellipses[e, S22]
    s, across = ellipses[e, SCALE], (s11 * s22 - s12 * s12) / s22
    lines[e, MIDDLE_U] = ellipses[e, ORIGIN_U] + ellipses[e, CENTRE_U]
    lines[e, MIDDLE_V] = ellipses[e, ORIGIN_V] + ellipses[e, CENTRE_V]
    lines[e, SLANT], lines[e, ACROSS], lines[e, DOWN] = s12 / s22, across, 1.0 / s22
    lines[e, ROOM], lines[e, FACTOR], lines[e, BEND] = 1.0 + levels[e, 0], s, s / across


@compiled_as_numpy
def _fill_spans(lines, rows, limit, step, width, spans):  # pragma: no cover - compiled
    """Fill spans for the rows of each ellipse, eight at a time: middle, value there, columns [begin, end) of the span,
    and of what is surely saturated of it.

    Parameters
    ----------
    rows
        (E, 3), of each ellipse: its first row of those looked at, the first that is not its own any more, its place in spans.
    """
    right, out = float(width), np.empty(SPANS)  # of its own: so LLVM sees that nothing overlaps
    for e in range(rows.shape[0]):
        middle_u, middle_v, slant = lines[e, MIDDLE_U], lines[e, MIDDLE_V], lines[e, SLANT]
        across, down, most = lines[e, ACROSS], lines[e, DOWN], lines[e, ROOM]
        factor, at = lines[e, FACTOR], rows[e, 2]
        spared = limit / factor
        for row in range(rows[e, 0], rows[e, 1], BLOCK):
            top = float(step // 2 + step * row)
            for i in range(BLOCK):
                dy = top + step * float(i) - middle_v
                room = most - dy * dy * down
                half = np.sqrt(max(room, 0.0) * across)
                core = np.sqrt(max(room - spared, 0.0) * across)
                core -= _SURELY * (1.0 + core)
                middle = middle_u + slant * dy
                out[i], out[8 + i] = middle, factor * room
                out[16 + i] = min(max(np.ceil(middle - half), 0.0), right)
                out[24 + i] = min(max(np.floor(middle + half) + 1.0, 0.0), right)
                out[32 + i] = min(max(np.ceil(middle - core), 0.0), right)
                out[40 + i] = min(max(np.floor(middle + core) + 1.0, 0.0), right)
            for i in range(SPANS):
                spans[at + i] = out[i]
            at += SPANS


@compiled
def _unpack(moments, k, m, z):  # pragma: no cover - compiled
    """Fill M (6, 6) = Σ mono monoᵀ and z (6,) = Σ Z mono from the sums of row k."""
    n = moments[k]
    m[0, 0], m[0, 1], m[0, 2], m[0, 3], m[0, 4], m[0, 5] = (
        n[4],
        2 * n[8],
        n[11],
        2 * n[3],
        2 * n[7],
        n[2],
    )
    m[1, 1], m[1, 2], m[1, 3], m[1, 4], m[1, 5] = (
        4 * n[11],
        2 * n[13],
        4 * n[7],
        4 * n[10],
        2 * n[6],
    )
    m[2, 2], m[2, 3], m[2, 4], m[2, 5] = n[14], 2 * n[10], 2 * n[12], n[9]
    m[3, 3], m[3, 4], m[3, 5] = 4 * n[2], 4 * n[6], 2 * n[1]
    m[4, 4], m[4, 5] = 4 * n[9], 2 * n[5]
    m[5, 5] = n[0]
    for i in range(1, 6):
        for j in range(i):
            m[i, j] = m[j, i]
    z[0], z[1], z[2] = n[18], 2.0 * n[20], n[21]
    z[3], z[4], z[5] = 2.0 * n[17], 2.0 * n[19], n[16]


@written(types.void)
def _fill_product(code, work, m, weight):
    """Fill work[120:168] with Aᵀ weight M A, (6, 8); A: work[72:120], (6, 8). As exact as scalar code, without fused products."""
    rows = [work.load(code.long(72 + 8 * i)) for i in range(6)]
    scaled = code.splat(weight)
    across = [
        reduce(Eight.plus, (scaled * m.scalar(6 * i + j) * rows[j] for j in range(6)))
        for i in range(6)
    ]
    for s in range(6):
        column = (work.scalar(72 + 8 * k + s) * across[k] for k in range(6))
        work.store(reduce(Eight.plus, column), code.long(120 + 8 * s))


@compiled
def _add_block(work, m, mc, z, weight, at, sums):  # pragma: no cover - compiled
    """Add Aᵀ(M c − z) and Aᵀ M A at row `at`; A is work[72:120] as (6, 8), work[120:168] is free."""
    for i in range(6):
        r = weight * (mc[i] - z[i])
        for t in range(6):
            sums.gradient[at + t] += r * work[72 + 8 * i + t]
    _fill_product(work, m, weight)
    for s in range(6):
        for t in range(6):
            sums.hessian[at + s, at + t] += work[120 + 8 * s + t]


@compiled
def _fill_shapes(rotation, turn, thick, radii, own, wide):  # pragma: no cover - compiled
    """Fill R diag(thick · radii) Rᵀ and R diag(thick) Rᵀ, with R = rotation · turn."""
    axes = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            axes[i, j] = (
                rotation[i, 0] * turn[0, j]
                + rotation[i, 1] * turn[1, j]
                + rotation[i, 2] * turn[2, j]
            )
    for i in range(3):
        for j in range(3):
            own[i, j], wide[i, j] = 0.0, 0.0
            for k in range(3):
                across = axes[i, k] * thick[k] * axes[j, k]
                wide[i, j] += across
                own[i, j] += across * radii[k]


@compiled
def _add_field(by, m, mc, z, weight, bone, sums):  # pragma: no cover - compiled
    """Add Aᵀ(M c − z) and Aᵀ M A of one ellipsoid to its bone's numbers; by: A (6, FIELD)."""
    at, product = FIELD * bone, np.empty(6)
    for t in range(FIELD):
        for i in range(6):
            product[i] = 0.0
            for j in range(6):
                product[i] += weight * m[i, j] * by[j, t]
            sums.gradient[at + t] += weight * by[i, t] * (mc[i] - z[i])
        for s in range(FIELD):
            for i in range(6):
                sums.hessian[at + s, at + t] += by[i, s] * product[i]
