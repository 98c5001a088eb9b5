"""Compiled sums of E1: each cloud point against the merged surface. The plain form: tests/model/metaballs_reference.py.

1. Points come in blocks that are compact in space. Bounds on an ellipsoid's distance over a block's sphere leave a few
   that can be closest somewhere in it; only those are tried.
2. Points with the same closest ellipsoid gather in a buffer of 128. It is worked off as one small dense
   problem: rows for the bones that count there, and their products. No point enters the system one by one.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types

from handtrack.compiled import compiled_as_numpy
from handtrack.model.metaballs_kernels import AXES, CENTRE, LEAST, STRETCH, TINY
from handtrack.terms.bone_kernels import add_outer, fill_arm
from handtrack.terms.lanes_kernels import DOUBLE, DOUBLES, LANES, ZEROS, Eight, exp, log, written
from handtrack.terms.loss import robust

# ---- Steps on eight points at a time


class _Ellipsoid:
    """One ellipsoid's numbers, loaded before the loop."""

    def __init__(self, code, ball, turning):
        self.centre = [ball.scalar(CENTRE + i) for i in range(3)]
        self.axes = [[ball.scalar(AXES + 3 * i + j) for j in range(3)] for i in range(3)]
        self.least = ball.scalar(LEAST)
        self.turning = code.splat(turning).at_least(TINY * (1 + 1e-9))

    def level(self, x):
        """Return X − c, y = diag(1/r) Rᵀ (X − c), k = |y| (not 0) and ρ²."""
        out = [x[i] - self.centre[i] for i in range(3)]
        y = [a[0] * out[0] + a[1] * out[1] + a[2] * out[2] for a in self.axes]
        k = (y[0] * y[0] + y[1] * y[1] + y[2] * y[2]).sqrt().at_least(TINY)
        return out, y, k, out[0] * out[0] + out[1] * out[1] + out[2] * out[2]

    def distance(self, x):
        _, _, k, rho2 = self.level(x)
        near = (k - 1.0) * self.least
        rho = rho2.sqrt()
        return near.where(k < self.turning, rho - rho / k)


def _is_positive(code, number):
    return code.builder.fcmp_ordered(">", number, ir.Constant(DOUBLE, 0.0))


def _rows(array, at, count=3, first=0):
    return [array.load(at, first + i) for i in range(count)]


@written(types.double)
def nearer(code, points, first, n, table, e, turning, nearest):
    """nearest (2, 8 n) = d_e and e where ellipsoid e is nearer, the first of equal ones; return the
    largest distance.

    Parameters
    ----------
    points
        From `first` on.
    """
    builder = code.builder
    ball = _Ellipsoid(code, table.row(e), turning)
    name = code.splat(builder.sitofp(e, DOUBLE))
    worst = code.highest()
    with code.groups(n) as at:
        d = ball.distance(_rows(points, code.plus(first, at)))
        old, holder = _rows(nearest, at, 2)
        equal = builder.and_(builder.fcmp_ordered("==", d.value, old.value), name < holder)
        closer = builder.or_(d < old, equal)
        d = d.where(closer, old)
        nearest.store(d, at)
        nearest.store(name.where(closer, holder), at, 1)
        code.meet(worst, d)
    return code.largest(worst)


@written(types.boolean)
def distances(code, points, n, ball, turning, margin, first, d):
    """d (8 n) = those of an ellipsoid; return whether any is below first + margin."""
    ball = _Ellipsoid(code, ball, turning)
    margin, closest = code.splat(margin), code.highest()
    with code.groups(n) as at:
        found = ball.distance(_rows(points, at))
        code.meet(closest, first.load(at) + margin - found)
        d.store(found, at)
    return _is_positive(code, code.largest(closest))


@written(types.boolean)
def gradients(code, points, n, ball, turning, margin, first, near):
    """As `distances`; near has rows d, nx, ny and nz."""
    ball = _Ellipsoid(code, ball, turning)
    margin, closest = code.splat(margin), code.highest()
    with code.groups(n) as at:
        out, y, k, rho2 = ball.level(_rows(points, at))
        inside = k < ball.turning
        rho = rho2.at_least(1e-60).sqrt()
        both = 1.0 / (k * rho)  # one division for all
        inverse = both * rho
        share = inverse * rho  # ρ/k
        along = (ball.least * inverse).where(inside, share * inverse * inverse)
        outward = Eight(code.builder, ZEROS).where(inside, both * k - both)
        d = ((k - 1.0) * ball.least).where(inside, rho - share)
        code.meet(closest, first.load(at) + margin - d)
        near.store(d, at)
        for j in range(3):
            g = ball.axes[0][j] * y[0] + ball.axes[1][j] * y[1] + ball.axes[2][j] * y[2]
            near.store(along * g + outward * out[j], at, j + 1)
    return _is_positive(code, code.largest(closest))


@written(types.void)
def shares(code, first, other, n, sharpness, share, total):
    """share = exp(−β (d_other − d_first)), added to total (8 n)."""
    beta = code.splat(sharpness)
    with code.groups(n) as at:
        part = exp((first.load(at) - other.load(at)) * beta)
        share.store(part, at)
        total.store(total.load(at) + part, at)


@written(types.void)
def merge(code, first, n, sharpness, total, distance):
    """distance (8 n) = d_first − log(total)/β; total becomes its inverse."""
    blur = 1.0 / code.splat(sharpness)
    with code.groups(n) as at:
        whole = total.load(at)
        distance.store(first.load(at) - log(whole) * blur, at)
        total.store(1.0 / whole, at)


@written(types.void)
def twist_rows(code, points, n, reference, near, factor, rows):
    """rows (6, 8 n) = factor · [n ; (X − o) × n]."""
    o = [reference.scalar(i) for i in range(3)]
    with code.groups(n) as at:
        x = [point - o[i] for i, point in enumerate(_rows(points, at))]
        scale = factor.load(at)
        m = [normal * scale for normal in _rows(near, at, 3, 1)]
        turn = [x[(i + 1) % 3] * m[(i + 2) % 3] - x[(i + 2) % 3] * m[(i + 1) % 3] for i in range(3)]
        for i, value in enumerate(m + turn):
            rows.store(value, at, i)


def _sums(code, n, pairs, read, out, first):
    """Store Σ over lanes and groups of the products in `pairs`; read(at) returns the rows they name."""
    builder = code.builder
    totals = []
    for _ in pairs:
        slot = cgutils.alloca_once(builder, DOUBLES)
        builder.store(ZEROS, slot)
        totals.append(slot)
    with code.groups(n) as at:
        rows = read(at)
        for slot, (i, j) in zip(totals, pairs, strict=True):
            old = Eight(builder, builder.load(slot))
            builder.store((rows[i] * rows[j] + old).value, slot)
    for k, slot in enumerate(totals):
        out.set_scalar(Eight(builder, builder.load(slot)).sum(), first + k)


@written(types.void)
def own_products(code, rows, n, residual, out):
    """out (27) = the upper half of R Rᵀ, row by row, and R r, for six rows R."""
    pairs = [(i, j) for i in range(6) for j in range(i, 6)] + [(i, 6) for i in range(6)]
    _sums(code, n, pairs, lambda at: [*_rows(rows, at, 6), residual.load(at)], out, 0)


@written(types.void)
def cross_products(code, rows, others, n, out):
    """out (36) = R Qᵀ for six rows R and six rows Q."""
    for half in (0, 3):  # 18 sums at a time stay in registers

        def read(at, half=half):
            return _rows(rows, at, 3, half) + _rows(others, at, 6)

        _sums(code, n, [(i, 3 + j) for i in range(3) for j in range(6)], read, out, 6 * half)


# ---- The sums


BLOCK = 32
"""points of a block in space"""
BUFFER = 128
"""points that are worked off together"""
NEGLIGIBLE = 25.0
"""An ellipsoid whose weight is below e^−25 of the closest one's counts for nothing: 1e-11."""


@compiled_as_numpy
def aligned(count):  # pragma: no cover - compiled
    """Return an empty array (count,) that starts on a cache line: vectors that straddle two cost twice."""
    memory = np.empty(count + LANES)
    start = (-memory.ctypes.data // 8) % LANES
    return memory[start : start + count]


@compiled_as_numpy
def cloud_sums(cloud, surface, sigma, loss, weight, reference, sums):  # pragma: no cover - compiled
    """Add E1 to sums; return ½ weight Σ ρ(d²/σ²)."""
    points, count, spheres = cloud
    table, _, start, members, sharpness, turning = surface
    width = sums.width
    ellipsoids = table.shape[0]
    low, least_high = bounds(table, turning, spheres)
    buffers = aligned(ellipsoids * 3 * BUFFER).reshape(ellipsoids, 3, BUFFER)
    filled = np.zeros(ellipsoids, np.int64)
    wanted = np.zeros(members.shape[0], np.bool_)
    nearest = aligned(2 * BLOCK).reshape(2, BLOCK)
    best, who = nearest[0], nearest[1]
    tried = np.empty(ellipsoids, np.int64)
    most = 0
    for e in range(ellipsoids):
        most = max(most, start[e + 1] - start[e])
    near = aligned(most * 5 * BUFFER).reshape(most, 5, BUFFER)
    rows = aligned(most * 6 * BUFFER).reshape(most, 6, BUFFER)
    vectors = aligned(5 * BUFFER).reshape(5, BUFFER)
    wide = np.empty((12 * most if width == 12 else 0, BUFFER))
    space = buffers, wanted, near, rows, wide, vectors
    noise = sigma, loss, weight
    margin = NEGLIGIBLE / sharpness
    cost = 0.0
    for block in range((count + BLOCK - 1) // BLOCK + 1):
        first = block * BLOCK
        here = min(count - first, BLOCK)
        last = here <= 0
        tries, first_try = 0, 0
        for e in range(ellipsoids):
            if last or low[e, block] <= least_high[block]:
                tried[tries] = e
                if not last and low[e, block] < low[tried[first_try], block]:
                    first_try = tries
                tries += 1
        worst = least_high[block] if not last else 0.0
        if tries == 1:
            who[:] = tried[0]
        elif not last:
            best[:], who[:] = np.inf, ellipsoids
            groups = (here + LANES - 1) // LANES
            likely = tried[first_try]
            worst = nearer(points, first, groups, table, likely, turning, nearest)
            kept = 0
            for t in range(tries):  # those that the likely one beats at every point need no look
                e = tried[t]
                if e != likely:
                    if low[e, block] > worst:
                        continue
                    worst = nearer(points, first, groups, table, e, turning, nearest)
                tried[kept] = e
                kept += 1
            tries = kept
        for t in range(
            tries
        ):  # room for a whole block in each buffer; at the end all are worked off
            e = tried[t]
            if filled[e] > (0 if last else BUFFER - BLOCK):
                cost += work_off(e, filled[e], surface, noise, reference, space, sums)
                filled[e] = 0
            if not last:
                for n in range(start[e], start[e + 1]):
                    wanted[n] |= low[members[n], block] <= worst + margin
        for i in range(here):
            e = np.int64(who[i])
            at = filled[e]
            for axis in range(3):
                buffers[e, axis, at] = points[axis, first + i]
            filled[e] = at + 1
    return 0.5 * weight * cost


@compiled_as_numpy
def bounds(table, turning, spheres):  # pragma: no cover - compiled
    """Return low (E, blocks'), lower bounds of the distances over spheres, and the least upper bounds (blocks',).

    Exact distance at a sphere's centre, plus or minus its steepest slope times the radius.
    """
    blocks = spheres.shape[1]
    low = aligned(table.shape[0] * blocks).reshape(table.shape[0], blocks)
    least_high = np.full(blocks, np.inf)
    for e in range(table.shape[0]):
        distances(spheres, blocks // LANES, table[e], turning, 0.0, low[0], low[e])
        stretch = table[e, STRETCH]
        for i in range(blocks):
            change = stretch * spheres[3, i]
            d = max(low[e, i], 0.0) if turning == 0.0 else low[e, i]
            least_high[i] = min(least_high[i], d + change)
            low[e, i] -= change
        if turning == 0.0:  # d2 has no bounded slope inside
            for i in range(blocks):
                if low[e, i] < 0.0:
                    low[e, i] = -np.inf
    return low, least_high


@compiled_as_numpy
def arrange(points, order, size):  # pragma: no cover - compiled
    """Reorder `order` (N,) so that each run of `size` points is compact: halves along the longest side, again and again."""
    stack = np.empty((64, 2), np.int64)
    stack[0, 0], stack[0, 1] = 0, order.shape[0]
    depth = 1
    while depth > 0:
        depth -= 1
        a, b = stack[depth, 0], stack[depth, 1]
        if b - a <= size:
            continue
        axis, widest = 0, -1.0
        for k in range(3):
            least, most = np.inf, -np.inf
            for i in range(a, b):
                least, most = min(least, points[order[i], k]), max(most, points[order[i], k])
            if most - least > widest:
                axis, widest = k, most - least
        middle = a + ((b - a + size - 1) // size // 2) * size
        low, high = a, b - 1
        while low < high:  # quickselect: order[middle] gets the value that belongs there
            pivot = points[order[(low + high) // 2], axis]
            i, j = low, high
            while i <= j:
                while points[order[i], axis] < pivot:
                    i += 1
                while points[order[j], axis] > pivot:
                    j -= 1
                if i <= j:
                    order[i], order[j] = order[j], order[i]
                    i += 1
                    j -= 1
            if middle <= j:
                high = j
            elif middle >= i:
                low = i
            else:
                break
        stack[depth, 0], stack[depth, 1] = a, middle
        stack[depth + 1, 0], stack[depth + 1, 1] = middle, b
        depth += 2


@compiled_as_numpy
def work_off(e, count, surface, noise, reference, space, sums):  # pragma: no cover - compiled
    """Add the buffered points of ellipsoid e; returns Σ ρ.

    Parameters
    ----------
    noise
        σ, loss and weight.
    space
        Points that wait, by the ellipsoid closest to them; which of the surface's links may count
        for them; distance, direction and share of each ellipsoid that counts at those that are
        worked off; rows by twists, and by fields; numbers of each point.
    """
    table, bone, start, members, sharpness, turning = surface
    buffers, wanted, near, rows, wide, vectors = space
    sigma, loss, weight = noise
    width, gradient, hessian = sums
    for i in range(count, (count + LANES - 1) // LANES * LANES):
        for axis in range(3):
            buffers[e, axis, i] = buffers[e, axis, count - 1]
    groups = (count + LANES - 1) // LANES
    points = buffers[e]
    total, distance, factor = vectors[0], vectors[1], vectors[2]
    residual, size = vectors[3], vectors[4]
    who = np.empty(near.shape[0], np.int64)
    total[:], near[0, 4] = 1.0, 1.0
    who[0], used = e, 1
    margin = NEGLIGIBLE / sharpness
    if width > 0:
        gradients(points, groups, table[e], turning, margin, near[0, 0], near[0])
    else:
        distances(points, groups, table[e], turning, margin, near[0, 0], near[0, 0])
    for n in range(start[e] + 1, start[e + 1]):
        if not wanted[n]:
            continue
        wanted[n] = False
        other, mine = members[n], near[used]
        if width > 0:
            counts = gradients(points, groups, table[other], turning, margin, near[0, 0], mine)
        else:
            counts = distances(points, groups, table[other], turning, margin, near[0, 0], mine[0])
        if not counts:
            continue
        shares(near[0, 0], mine[0], groups, sharpness, mine[4], total)
        who[used], used = other, used + 1
    if used > 1:
        merge(near[0, 0], groups, sharpness, total, distance)
    else:
        distance[:] = near[0, 0]
    cost = _fill_robust(loss, sigma, count, distance, residual, size)
    if width == 0:
        return cost
    for i in range(8 * groups):
        strength = np.sqrt(weight * size[i])
        residual[i] *= strength
        size[i] = -strength * total[i] / sigma
    for a in range(used):
        for i in range(8 * groups):
            factor[i] = size[i] * near[a, 4, i]
        if width == 12:
            _fill_wide(
                buffers[e],
                count,
                table[who[a]],
                turning,
                reference,
                near[a],
                factor,
                wide[12 * a :],
            )
            continue
        twist_rows(points, groups, reference, near[a], factor, rows[a])
    if width == 12:
        _add_wide(bone, who[:used], count, wide, residual, sums)
        return cost
    sums = np.empty(36)
    for a in range(used):
        at = width * bone[who[a]]
        own_products(rows[a], groups, residual, sums)
        k = 0
        for i in range(6):
            gradient[at + i] += sums[21 + i]
            hessian[at + i, at + i] += sums[k]
            k += 1
            for j in range(i + 1, 6):
                hessian[at + i, at + j] += sums[k]
                hessian[at + j, at + i] += sums[k]
                k += 1
        for b in range(a + 1, used):
            cross_products(rows[a], rows[b], groups, sums)
            to = width * bone[who[b]]
            for i in range(6):
                for j in range(6):
                    hessian[at + i, to + j] += sums[6 * i + j]
                    hessian[to + j, at + i] += sums[6 * i + j]
    return cost


@compiled_as_numpy
def _fill_wide(
    points, count, ball, turning, reference, near, factor, wide
):  # pragma: no cover - compiled
    """Fill wide (12, N), by (v, G), with factor · [n ; n (X − o)ᵀ − d t tᵀ] of one ellipsoid: a distance along t grows as G says."""
    row, t = np.empty(12), np.empty(3)
    for i in range(count):
        for k in range(3):
            row[k], t[k] = near[1 + k, i], points[k, i] - ball[CENTRE + k]
        level, least = 0.0, np.inf
        for axis in range(AXES, AXES + 9, 3):
            level += (ball[axis] * t[0] + ball[axis + 1] * t[1] + ball[axis + 2] * t[2]) ** 2
        if level < turning * turning:  # inside, lengths are those of the shortest axis
            for axis in range(AXES, AXES + 9, 3):
                radius = (ball[axis] ** 2 + ball[axis + 1] ** 2 + ball[axis + 2] ** 2) ** -0.5
                if radius < least:
                    least = radius
                    for k in range(3):
                        t[k] = ball[axis + k]
        x, y, z = points[0, i], points[1, i], points[2, i]
        fill_arm(row, 0, 12, x - reference[0], y - reference[1], z - reference[2])
        square = max(t[0] * t[0] + t[1] * t[1] + t[2] * t[2], TINY**2)
        add_outer(row, 0, -near[0, i] / square, t, t)
        for k in range(12):
            wide[k, i] = factor[i] * row[k]


@compiled_as_numpy
def _add_wide(bone, who, count, wide, residual, sums):  # pragma: no cover - compiled
    """Add what rows (12 · used, N) by the fields of the bones make of the points that are worked off."""
    used, gradient, hessian = who.shape[0], sums.gradient, sums.hessian
    for a in range(12 * used):
        at = 12 * bone[who[a // 12]] + a % 12
        for i in range(count):
            gradient[at] += wide[a, i] * residual[i]
        for b in range(12 * used):
            to, total = 12 * bone[who[b // 12]] + b % 12, 0.0
            for i in range(count):
                total += wide[a, i] * wide[b, i]
            hessian[at, to] += total


@compiled_as_numpy
def _fill_robust(loss, sigma, count, distance, residual, size):  # pragma: no cover - compiled
    """Fill residual = d/σ and size = dρ/d(r²), 0 behind the last point; returns Σ ρ."""
    cost = 0.0
    for i in range(count):
        r = distance[i] / sigma
        value, size[i] = robust(loss, r * r)
        residual[i] = r
        cost += value
    for i in range(count, (count + LANES - 1) // LANES * LANES):
        residual[i], size[i] = 0.0, 0.0
    return cost
