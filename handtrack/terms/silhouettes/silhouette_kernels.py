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

import numba
import numpy as np

from handtrack.terms.ellipsoid_kernels import posed_shapes
from handtrack.terms.silhouettes.conic_kernels import (
    CENTRE_U,
    CENTRE_V,
    ELLIPSE,
    ORIGIN_U,
    ORIGIN_V,
    S11,
    S12,
    S22,
    SCALE,
    conic_by_twist,
    conic_of,
    project,
)
from handtrack.terms.silhouettes.row_kernels import (
    BLOCK,
    MOMENTS,
    PADDING,
    add_run,
    add_seen,
    clear,
    find_runs,
    number_at,
    paint,
)
from handtrack.terms.term_table import (
    GRADIENT,
    HESSIAN,
    POSITION,
    REFERENCE,
    ROTATION,
    TermKernel,
    array1,
    array2,
    array3,
)

MIDDLE_U, MIDDLE_V, SLANT, ACROSS, DOWN, ROOM, FACTOR, BEND = range(8)
"""Columns of `lines`: the ellipse's centre [px]; d middle / d row; half-width² per unit of room; room lost per row²;
room on the centre's row; factor; curvature of the value along the row."""
LINE = 8


@numba.njit(cache=True, nogil=True)
def camera_system(
    rotation, position, reference, bone, centre, turn, radii, projection, valid, begins, runs, values, powers, heights,
    levels, limit, depth_scaled, step, weight, want_system, gradient, hessian,
):  # fmt: skip  # pragma: no cover - compiled
    """Add one camera's ½ weight Σ (P − Z)² to gradient (6B,) and hessian (6B, 6B). Returns (cost, area, overlap).

    The returned cost leaves out ½ weight ΣZ², which does not depend on the pose. area: pixels that the model covers,
    overlap: −ΣZ over them. begins, runs, values: what was observed, see `PreparedSilhouette`; levels: (E, 2) outer level t and
    factor s. step: of so many rows one is looked at, which stands for all.
    """
    count, height, width = bone.shape[0], valid.shape[0], (powers.shape[0] - 1) // 2
    centre_world, shape_world = np.empty((count, 3)), np.empty((count, 3, 3))
    posed_shapes(rotation, position, bone, centre, turn, radii, centre_world, shape_world)
    ellipses = np.zeros((count + 2, ELLIPSE))
    project(projection, width, height, centre_world, shape_world, levels, depth_scaled, ellipses)
    moments = np.zeros((count + 2, MOMENTS))
    _sum_rows(ellipses, levels, limit, step, valid, begins, runs, values, powers, heights, moments)
    weight *= step
    area, overlap = 0.0, 0.0
    for k in range(1, count + 2):
        area += moments[k, 0]
        overlap -= moments[k, 16]
    core = count + 1
    cost = 0.5 * moments[core, 0] + moments[core, 16]
    m, z = np.zeros((6, 6)), np.zeros(6)
    c, mc = np.empty(6), np.empty(6)
    work = np.zeros(176)
    for e in range(count):
        if moments[e + 1, 0] == 0.0:
            continue
        _unpack(moments[e + 1], m, z)
        conic_of(ellipses[e], levels[e, 0], c)
        for i in range(6):
            mc[i] = 0.0
            for j in range(6):
                mc[i] += m[i, j] * c[j]
            cost += c[i] * (0.5 * mc[i] - z[i])
        if want_system:
            conic_by_twist(
                projection,
                centre_world[e],
                shape_world[e],
                reference,
                ellipses[e],
                levels[e, 0],
                depth_scaled,
                work,
            )
            _add_block(work, m, mc, z, weight, 6 * bone[e], gradient, hessian)
    return weight * cost, step * area, step * overlap


@TermKernel("i8 f8 f8 f8 f8 i4 i8 i8 f8 f8 f8 f8 f8")
def silhouette_kernel(term, place, width):  # pragma: no cover - compiled
    """½ weight Σ (P − Z)² of one camera; the table is made by `FieldTerm.tables`."""
    scalars = array1(term, 12, np.float64)
    part, _, _ = camera_system(
        array3(place, ROTATION, np.float64), array2(place, POSITION, np.float64), array1(place, REFERENCE, np.float64),
        array1(term, 0, np.int64), array2(term, 1, np.float64), array3(term, 2, np.float64), array2(term, 3, np.float64),
        array2(term, 4, np.float64), array2(term, 5, np.int32), array1(term, 6, np.int64), array2(term, 7, np.int64),
        array1(term, 8, np.float64), array2(term, 9, np.float64), array2(term, 10, np.float64),
        array2(term, 11, np.float64), scalars[0],
        scalars[1] != 0.0, np.int64(scalars[4]), scalars[2], width > 0, array1(place, GRADIENT, np.float64), array2(place, HESSIAN, np.float64),
    )  # fmt: skip
    return max(part + 0.5 * scalars[2] * scalars[3], 0.0)


@numba.njit(cache=True, nogil=True)
def _sum_rows(
    ellipses, levels, limit, step, valid, begins, seen, values, powers, heights, moments
):  # pragma: no cover - compiled
    """Fill moments (E + 2, MOMENTS): of nobody, of each ellipse where it wins, of saturated pixels."""
    count, height, width = levels.shape[0], valid.shape[0], (powers.shape[0] - 1) // 2
    lines = np.empty((count, LINE))
    first, last = np.zeros(count, np.int64), np.zeros(count, np.int64)
    looked_at = (height - step // 2 + step - 1) // step  # rows step // 2, step // 2 + step, …
    start = np.zeros(looked_at + 1, np.int64)
    for e in range(count):  # which of them each ellipse reaches, and what its spans need
        if ellipses[e, SCALE] == 0.0:
            continue
        _row_line(ellipses[e], levels[e, 0], lines[e])
        reach = np.sqrt((1.0 + levels[e, 0]) * ellipses[e, S22])
        middle = lines[e, MIDDLE_V] - step // 2
        first[e] = np.int64(min(max(np.ceil((middle - reach) / step), 0.0), float(looked_at)))
        last[e] = np.int64(min(max(np.floor((middle + reach) / step) + 1.0, 0.0), float(looked_at)))
        for row in range(first[e], last[e]):
            start[row + 1] += 1
    for row in range(looked_at):
        start[row + 1] += start[row]
    items, filled = np.empty(start[looked_at], np.int64), start.copy()
    for e in range(count):
        for row in range(first[e], last[e]):
            items[filled[row]] = e
            filled[row] += 1
    origins = np.zeros((count + 2, 2), np.int64)  # in the numbering of `moments`
    for e in range(count):
        origins[e + 1, 0] = np.int64(ellipses[e, ORIGIN_U])
        origins[e + 1, 1] = np.int64(ellipses[e, ORIGIN_V])
    memory = np.zeros(width + PADDING + BLOCK)
    buffer = memory[
        (-memory.ctypes.data // 8) % BLOCK :
    ]  # blocks that straddle two cache lines cost more
    starts = np.empty(buffer.shape[0] + BLOCK, np.int64)
    for row in range(looked_at):
        if start[row] == start[row + 1]:
            continue
        v = step // 2 + step * row
        low, high = _paint_row(
            v, items[start[row] : start[row + 1]], lines, limit, valid[v, 0], valid[v, 1], buffer
        )
        if low >= high:
            continue
        runs = find_runs(buffer, low, high, starts)
        left, piece, pieces = low, begins[v], begins[v + 1]
        for n in range(runs):
            right = starts[n + 1]
            k = number_at(buffer, left)
            u0, y = width - origins[k, 0], v + height - origins[k, 1]
            add_run(moments, k, powers, left + u0, right + u0, heights, y)
            while piece < pieces and seen[piece, 0] < right:
                a, b = max(left, seen[piece, 0]), min(right, seen[piece, 1])
                if a < b:
                    add_seen(moments, k, powers, a + u0, b + u0, heights, y, values[piece])
                if seen[piece, 1] > right:
                    break
                piece += 1
            left = right
        clear(buffer, low, high)


@numba.njit(cache=True, nogil=True)
def _row_line(ellipse, outer, line):  # pragma: no cover - compiled
    """Fill what an ellipse's span on a row needs: all divisions, once for all rows."""
    s11, s12, s22, s = ellipse[S11], ellipse[S12], ellipse[S22], ellipse[SCALE]
    across = (s11 * s22 - s12 * s12) / s22
    line[MIDDLE_U] = ellipse[ORIGIN_U] + ellipse[CENTRE_U]
    line[MIDDLE_V] = ellipse[ORIGIN_V] + ellipse[CENTRE_V]
    line[SLANT], line[ACROSS], line[DOWN] = s12 / s22, across, 1.0 / s22
    line[ROOM], line[FACTOR], line[BEND] = 1.0 + outer, s, s / across


@numba.njit(cache=True, nogil=True)
def _paint_row(v, items, lines, limit, begin, end, buffer):  # pragma: no cover - compiled
    """Paint all ellipses of row v; returns the columns [low, high), inside [begin, end), that they reach."""
    low, high = np.int64(end), np.int64(begin)
    core = lines.shape[0] + 1
    for e in items:
        dy = v - lines[e, MIDDLE_V]
        room = lines[e, ROOM] - dy * dy * lines[e, DOWN]
        half = np.sqrt(max(room, 0.0) * lines[e, ACROSS])
        middle = lines[e, MIDDLE_U] + lines[e, SLANT] * dy
        a = np.int64(np.ceil(max(middle - half, float(begin))))
        b = np.int64(np.floor(min(middle + half, end - 1.0))) + 1
        if a < b:
            low, high = min(low, a), max(high, b)
            paint(buffer, a, b, middle, lines[e, FACTOR] * room, lines[e, BEND], limit, e + 1, core)
    return low, high


@numba.njit(cache=True, nogil=True)
def _unpack(n, m, z):  # pragma: no cover - compiled
    """Fill M (6, 6) = Σ mono monoᵀ and z (6,) = Σ Z mono from the sums."""
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


@numba.njit(cache=True, nogil=True)
def _add_block(work, m, mc, z, weight, at, gradient, hessian):  # pragma: no cover - compiled
    """Add Aᵀ(M c − z) and Aᵀ M A at row `at`; A is work[72:120] as (6, 8), work[120:176] is free."""
    for i in range(6):
        m0, m1, m2 = weight * m[i, 0], weight * m[i, 1], weight * m[i, 2]
        m3, m4, m5 = weight * m[i, 3], weight * m[i, 4], weight * m[i, 5]
        for t in range(8):
            work[120 + 8 * i + t] = (
                m0 * work[72 + t] + m1 * work[80 + t] + m2 * work[88 + t]
                + m3 * work[96 + t] + m4 * work[104 + t] + m5 * work[112 + t]
            )  # fmt: skip
    for i in range(6):
        r = weight * (mc[i] - z[i])
        for t in range(6):
            gradient[at + t] += r * work[72 + 8 * i + t]
    for s in range(6):
        a0, a1, a2 = work[72 + s], work[80 + s], work[88 + s]
        a3, a4, a5 = work[96 + s], work[104 + s], work[112 + s]
        for t in range(8):
            work[168 + t] = (
                a0 * work[120 + t] + a1 * work[128 + t] + a2 * work[136 + t]
                + a3 * work[144 + t] + a4 * work[152 + t] + a5 * work[160 + t]
            )  # fmt: skip
        for t in range(6):
            hessian[at + s, at + t] += work[168 + t]


@numba.njit(cache=True, nogil=True)
def count_runs(image, begins):  # pragma: no cover - compiled
    """Fill begins (H + 1,): how many runs of one value other than 0 the rows above have; returns how many there are."""
    height, width = image.shape
    begins[0] = 0
    for v in range(height):
        found = np.int64(image[v, 0] != 0)
        for u in range(1, width):
            found += (image[v, u] != image[v, u - 1]) & (image[v, u] != 0)
        begins[v + 1] = begins[v] + found
    return begins[height]


@numba.njit(cache=True, nogil=True)
def fill_runs(image, sign, valid, begins, runs, values, energy):  # pragma: no cover - compiled
    """Fill runs (K, 2), columns [begin, end), values (K,), sign · image, and each row's ΣZ² (H,). Returns −ΣZ.

    Both sums are of observed pixels.
    """
    height, width = image.shape
    energy[:] = 0.0
    area = 0.0
    for v in range(height):
        if begins[v] == begins[v + 1]:
            continue
        k, before = begins[v], np.float64(0.0)
        for u in range(width):
            z = np.float64(image[v, u])
            if z == before:
                continue
            if before != 0.0:
                runs[k - 1, 1] = u
            if z != 0.0:
                runs[k, 0], values[k] = u, sign * z
                k += 1
            before = z
        if before != 0.0:
            runs[k - 1, 1] = width
        for n in range(begins[v], begins[v + 1]):
            seen = min(runs[n, 1], valid[v, 1]) - max(runs[n, 0], valid[v, 0])
            if seen > 0:
                energy[v] += seen * values[n] * values[n]
                area -= seen * values[n]
    return area
