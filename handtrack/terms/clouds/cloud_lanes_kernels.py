"""The arithmetic of E1 on eight cloud points at a time.

`n` counts groups of eight; points and rows of numbers have x, y and z, or what they are of, in rows of one array.
"""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types

from handtrack.model.surfaces.metaballs_kernels import AXES, CENTRE, LEAST, TINY
from handtrack.terms.lanes_kernels import (
    DOUBLE,
    DOUBLES,
    ZEROS,
    Eight,
    exp,
    log,
    written,
)


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
