"""The arithmetic of E1 on eight cloud points at a time.

All indices are flat; `n` counts groups of eight; arrays of points hold x, y and z in rows that are `stride` apart.
"""

from __future__ import annotations

import math

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from handtrack.model.surfaces.metaballs_kernels import AXES, CENTRE, LEAST, TINY
from handtrack.terms.clouds.lanes_kernels import (
    DOUBLE,
    DOUBLES,
    LANES,
    LONG,
    ZEROS,
    Anywhere,
    Code,
    Eight,
    exp,
    log,
)


class _Ellipsoid:
    """One ellipsoid's numbers, loaded before the loop."""

    def __init__(self, code, table, e, turning):
        at = code.times(e, 16)
        self.centre = [code.scalar(table, at, CENTRE + i) for i in range(3)]
        self.axes = [[code.scalar(table, at, AXES + 3 * i + j) for j in range(3)] for i in range(3)]
        self.least = code.scalar(table, at, LEAST)
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


def _points(code, array, at, stride):
    return [code.load(array, code.plus(at, code.times(stride, i))) for i in range(3)]


@intrinsic
def nearer(typing, points, first, stride, n, table, e, turning, best, who):
    """best, who (8 n) = d_e and e where ellipsoid e is nearer, the first of equal ones; return the largest of `best`.

    points: flat, from `first` on.
    """
    signature = types.double(points, first, stride, n, table, e, turning, best, who)

    def generate(context, builder, signature, values):
        code = Code(context, builder, signature, values)
        ball = _Ellipsoid(code, 4, values[5], values[6])
        name = code.splat(builder.sitofp(values[5], DOUBLE))
        worst = cgutils.alloca_once(builder, DOUBLES)
        builder.store(ir.Constant(DOUBLES, [-math.inf] * LANES), worst)
        with code.groups(values[3]) as at:
            d = ball.distance(_points(code, 0, code.plus(values[1], at), values[2]))
            old, holder = code.load(7, at), code.load(8, at)
            equal = builder.and_(builder.fcmp_ordered("==", d.value, old.value), name < holder)
            closer = builder.or_(d < old, equal)
            d = d.where(closer, old)
            code.store(d, 7, at)
            code.store(name.where(closer, holder), 8, at)
            builder.store(d.at_least(Eight(builder, builder.load(worst))).value, worst)
        return Eight(builder, builder.load(worst)).largest()

    return signature, generate


@intrinsic
def distances(typing, points, n, stride, table, e, turning, margin, near, at_d):
    """Write d of ellipsoid e to near[at_d : at_d + 8 n]; return whether any is below near[: 8 n] + margin."""
    signature = types.boolean(points, n, stride, table, e, turning, margin, near, at_d)

    def generate(context, builder, signature, values):
        code = Code(context, builder, signature, values)
        ball = _Ellipsoid(code, 3, values[4], values[5])
        margin, close = code.splat(values[6]), Anywhere(code)
        with code.groups(values[1]) as at:
            d = ball.distance(_points(code, 0, at, values[2]))
            close.note(d < code.load(7, at) + margin)
            code.store(d, 7, code.plus(values[8], at))
        return close.answer()

    return signature, generate


@intrinsic
def gradients(typing, points, n, stride, table, e, turning, margin, near, at_d):
    """As `distances`; write nx, ny and nz too, to rows that are `stride` apart."""
    signature = types.boolean(points, n, stride, table, e, turning, margin, near, at_d)

    def generate(context, builder, signature, values):
        code = Code(context, builder, signature, values)
        ball = _Ellipsoid(code, 3, values[4], values[5])
        margin, close = code.splat(values[6]), Anywhere(code)
        with code.groups(values[1]) as at:
            out, y, k, rho2 = ball.level(_points(code, 0, at, values[2]))
            inside = k < ball.turning
            rho = rho2.at_least(1e-60).sqrt()
            both = 1.0 / (k * rho)  # one division for all
            inverse = both * rho
            share = inverse * rho  # ρ/k
            along = (ball.least * inverse).where(inside, share * inverse * inverse)
            outward = Eight(builder, ZEROS).where(inside, both * k - both)
            d = ((k - 1.0) * ball.least).where(inside, rho - share)
            close.note(d < code.load(7, at) + margin)
            place = code.plus(values[8], at)
            code.store(d, 7, place)
            for j in range(3):
                g = ball.axes[0][j] * y[0] + ball.axes[1][j] * y[1] + ball.axes[2][j] * y[2]
                row = code.plus(place, code.times(values[2], j + 1))
                code.store(along * g + outward * out[j], 7, row)
        return close.answer()

    return signature, generate


@intrinsic
def shares(typing, near, at_first, at_other, n, sharpness, share, at_share, total):
    """share = exp(−β (d_other − d_first)), added to total (8 n)."""
    signature = types.void(near, at_first, at_other, n, sharpness, share, at_share, total)

    def generate(context, builder, signature, values):
        code = Code(context, builder, signature, values)
        beta = code.splat(values[4])
        with code.groups(values[3]) as at:
            gap = code.load(0, code.plus(values[1], at)) - code.load(0, code.plus(values[2], at))
            part = exp(gap * beta)
            code.store(part, 5, code.plus(values[6], at))
            code.store(code.load(7, at) + part, 7, at)

    return signature, generate


@intrinsic
def merge(typing, near, at_first, n, sharpness, total, distance):
    """distance (8 n) = d_first − log(total)/β; total becomes its inverse."""
    signature = types.void(near, at_first, n, sharpness, total, distance)

    def generate(context, builder, signature, values):
        code = Code(context, builder, signature, values)
        blur = 1.0 / code.splat(values[3])
        with code.groups(values[2]) as at:
            whole = code.load(4, at)
            code.store(code.load(0, code.plus(values[1], at)) - log(whole) * blur, 5, at)
            code.store(1.0 / whole, 4, at)

    return signature, generate


@intrinsic
def twist_rows(typing, points, stride, n, reference, near, at_d, factor, rows, at_row):
    """Write factor · [n ; (X − o) × n] to six rows of `rows`, `stride` apart."""
    signature = types.void(points, stride, n, reference, near, at_d, factor, rows, at_row)

    def generate(context, builder, signature, values):
        code = Code(context, builder, signature, values)
        zero = ir.Constant(LONG, 0)
        o = [code.scalar(3, zero, i) for i in range(3)]
        with code.groups(values[2]) as at:
            point = _points(code, 0, at, values[1])
            x = [point[i] - o[i] for i in range(3)]
            scale = code.load(6, at)
            place = code.plus(values[5], at)
            m = [
                code.load(4, code.plus(place, code.times(values[1], i + 1))) * scale
                for i in range(3)
            ]
            turn = [
                x[(i + 1) % 3] * m[(i + 2) % 3] - x[(i + 2) % 3] * m[(i + 1) % 3] for i in range(3)
            ]
            for i, value in enumerate(m + turn):
                code.store(value, 7, code.plus(values[8], at, code.times(values[1], i)))

    return signature, generate


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
        code.set_scalar(Eight(builder, builder.load(slot)).sum(), out, ir.Constant(LONG, first + k))


@intrinsic
def own_products(typing, rows, at_row, stride, n, residual, out):
    """out (27) = the upper half of R Rᵀ, row by row, and R r, for six rows R."""
    signature = types.void(rows, at_row, stride, n, residual, out)

    def generate(context, builder, signature, values):
        code = Code(context, builder, signature, values)

        def read(at):
            rows = [
                code.load(0, code.plus(values[1], at, code.times(values[2], i))) for i in range(6)
            ]
            return [*rows, code.load(4, at)]

        pairs = [(i, j) for i in range(6) for j in range(i, 6)] + [(i, 6) for i in range(6)]
        _sums(code, values[3], pairs, read, 5, 0)

    return signature, generate


@intrinsic
def cross_products(typing, rows, at_row, at_other, stride, n, out):
    """out (36) = R Qᵀ for six rows R and six rows Q."""
    signature = types.void(rows, at_row, at_other, stride, n, out)

    def generate(context, builder, signature, values):
        code = Code(context, builder, signature, values)
        for half in (0, 3):  # 18 sums at a time stay in registers

            def read(at, half=half):
                mine = [
                    code.load(0, code.plus(values[1], at, code.times(values[3], half + i)))
                    for i in range(3)
                ]
                return mine + [
                    code.load(0, code.plus(values[2], at, code.times(values[3], i)))
                    for i in range(6)
                ]

            pairs = [(i, 3 + j) for i in range(3) for j in range(6)]
            _sums(code, values[4], pairs, read, 5, 6 * half)

    return signature, generate
