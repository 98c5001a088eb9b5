"""Eight cloud points at a time: the arithmetic of E1 as fixed vectors, which any CPU's compiler splits as it needs.

Left to itself, LLVM does not vectorise these loops: too many arrays that might overlap. All indices are flat; `n` counts
groups of eight; arrays of points hold x, y and z in rows that are `stride` apart.
"""

from __future__ import annotations

import math

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from handtrack.model.metaballs_kernels import AXES, CENTRE, LEAST, TINY

LANES = 8
_DOUBLE, _LONG = ir.DoubleType(), ir.IntType(64)
_DOUBLES, _LONGS = ir.VectorType(_DOUBLE, LANES), ir.VectorType(_LONG, LANES)
_ZEROS = ir.Constant(_DOUBLES, [0.0] * LANES)
_FUSE = ("contract",)


class _Eight:
    """Eight numbers in the code being written; arithmetic appends instructions."""

    def __init__(self, builder, value):
        self.builder, self.value = builder, value

    def _lift(self, other):
        if isinstance(other, _Eight):
            return other.value
        return ir.Constant(_DOUBLES, [float(other)] * LANES)

    def __add__(self, other):
        return _Eight(self.builder, self.builder.fadd(self.value, self._lift(other), flags=_FUSE))

    def __sub__(self, other):
        return _Eight(self.builder, self.builder.fsub(self.value, self._lift(other), flags=_FUSE))

    def __mul__(self, other):
        return _Eight(self.builder, self.builder.fmul(self.value, self._lift(other), flags=_FUSE))

    def __truediv__(self, other):
        return _Eight(self.builder, self.builder.fdiv(self.value, self._lift(other)))

    def __rtruediv__(self, other):
        return _Eight(self.builder, self.builder.fdiv(self._lift(other), self.value))

    def __lt__(self, other):
        return self.builder.fcmp_ordered("<", self.value, self._lift(other))

    def _call(self, name, *others):
        kind = ir.FunctionType(_DOUBLES, [_DOUBLES] * (1 + len(others)))
        function = cgutils.get_or_insert_function(self.builder.module, kind, f"llvm.{name}.v8f64")
        return _Eight(
            self.builder, self.builder.call(function, [self.value, *map(self._lift, others)])
        )

    def sqrt(self):
        return self._call("sqrt")

    def at_least(self, other):
        return self._call("maxnum", other)

    def rounded(self):
        return self._call("rint")

    def where(self, mask, other):
        """Return self where mask holds, else other."""
        return _Eight(self.builder, self.builder.select(mask, self.value, self._lift(other)))

    def sum(self):
        """Return the scalar sum, always in the same order."""
        kind = ir.FunctionType(_DOUBLE, [_DOUBLE, _DOUBLES])
        function = cgutils.get_or_insert_function(
            self.builder.module, kind, "llvm.vector.reduce.fadd.v8f64"
        )
        return self.builder.call(
            function, [ir.Constant(_DOUBLE, -0.0), self.value], fastmath=("reassoc",)
        )


class _Code:
    """Access to arrays and scalars while an intrinsic is being written."""

    def __init__(self, context, builder, signature, values):
        self.context, self.builder = context, builder
        self.kinds, self.values = signature.args, values

    def _pointer(self, array, index, element):
        kind = self.kinds[array]
        assert kind.layout == "C"
        data = self.context.make_array(kind)(self.context, self.builder, self.values[array]).data
        return self.builder.bitcast(self.builder.gep(data, [index]), element.as_pointer())

    def load(self, array, index):
        return _Eight(
            self.builder, self.builder.load(self._pointer(array, index, _DOUBLES), align=1)
        )

    def store(self, value, array, index):
        self.builder.store(value.value, self._pointer(array, index, _DOUBLES), align=1)

    def scalar(self, array, index, shift=0):
        at = self.builder.add(index, ir.Constant(_LONG, shift))
        return self.splat(self.builder.load(self._pointer(array, at, _DOUBLE)))

    def set_scalar(self, value, array, index, shift=0):
        at = self.builder.add(index, ir.Constant(_LONG, shift))
        self.builder.store(value, self._pointer(array, at, _DOUBLE))

    def splat(self, value):
        one = self.builder.insert_element(
            ir.Constant(_DOUBLES, ir.Undefined), value, ir.Constant(ir.IntType(32), 0)
        )
        lanes = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return _Eight(self.builder, self.builder.shuffle_vector(one, one, lanes))

    def times(self, a, b):
        return self.builder.mul(a, b if not isinstance(b, int) else ir.Constant(_LONG, b))

    def plus(self, *parts):
        total = parts[0]
        for part in parts[1:]:
            total = self.builder.add(
                total, part if not isinstance(part, int) else ir.Constant(_LONG, part)
            )
        return total

    def groups(self, n):
        """Return a context that yields the flat place 8 g of each group g < n."""
        return _Groups(self, n)


class _Groups:
    def __init__(self, code, n):
        self.code, self.loop = code, cgutils.for_range(code.builder, n)

    def __enter__(self):
        return self.code.times(self.loop.__enter__().index, LANES)

    def __exit__(self, *caught):
        return self.loop.__exit__(*caught)


class _Ellipsoid:
    """One ellipsoid's numbers, loaded before the loop."""

    def __init__(self, code, table, e, turning):
        at = code.times(e, 16)
        self.centre = [code.scalar(table, at, CENTRE + i) for i in range(3)]
        self.axes = [
            [code.scalar(table, at, AXES + 3 * i + j) for j in range(3)] for i in range(3)
        ]
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
    """best, who (8 n) = d_e and e where ellipsoid e is nearer than `best`. points: flat, from `first` on."""
    signature = types.void(points, first, stride, n, table, e, turning, best, who)

    def generate(context, builder, signature, values):
        code = _Code(context, builder, signature, values)
        ball = _Ellipsoid(code, 4, values[5], values[6])
        name = code.splat(builder.sitofp(values[5], _DOUBLE))
        with code.groups(values[3]) as at:
            d = ball.distance(_points(code, 0, code.plus(values[1], at), values[2]))
            old = code.load(7, at)
            closer = d < old
            code.store(d.where(closer, old), 7, at)
            code.store(name.where(closer, code.load(8, at)), 8, at)

    return signature, generate


@intrinsic
def distances(typing, points, first, stride, n, table, e, turning, near, at_d):
    """Write d of ellipsoid e to near[at_d : at_d + 8 n]."""
    signature = types.void(points, first, stride, n, table, e, turning, near, at_d)

    def generate(context, builder, signature, values):
        code = _Code(context, builder, signature, values)
        ball = _Ellipsoid(code, 4, values[5], values[6])
        with code.groups(values[3]) as at:
            d = ball.distance(_points(code, 0, code.plus(values[1], at), values[2]))
            code.store(d, 7, code.plus(values[8], at))

    return signature, generate


@intrinsic
def reaches(typing, points, first, stride, n, table, e, turning, margin, near, at_d):
    """Return whether ellipsoid e is anywhere within `margin` of the distances near[at_d : at_d + 8 n]."""
    signature = types.boolean(points, first, stride, n, table, e, turning, margin, near, at_d)

    def generate(context, builder, signature, values):
        code = _Code(context, builder, signature, values)
        ball = _Ellipsoid(code, 4, values[5], values[6])
        margin = code.splat(values[7])
        bits = ir.VectorType(ir.IntType(1), LANES)
        found = cgutils.alloca_once_value(builder, ir.Constant(bits, [0] * LANES))
        builder.store(ir.Constant(bits, [0] * LANES), found)
        with code.groups(values[3]) as at:
            d = ball.distance(_points(code, 0, code.plus(values[1], at), values[2]))
            close = d < code.load(8, code.plus(values[9], at)) + margin
            builder.store(builder.or_(builder.load(found), close), found)
        packed = builder.bitcast(builder.load(found), ir.IntType(8))
        return builder.icmp_unsigned("!=", packed, ir.Constant(ir.IntType(8), 0))

    return signature, generate


@intrinsic
def gradients(typing, points, first, stride, n, table, e, turning, near, at_d):
    """Write d, nx, ny, nz of ellipsoid e to four rows of `near`, `stride` apart, from at_d on."""
    signature = types.void(points, first, stride, n, table, e, turning, near, at_d)

    def generate(context, builder, signature, values):
        code = _Code(context, builder, signature, values)
        ball = _Ellipsoid(code, 4, values[5], values[6])
        with code.groups(values[3]) as at:
            out, y, k, rho2 = ball.level(_points(code, 0, code.plus(values[1], at), values[2]))
            inside = k < ball.turning
            rho = rho2.at_least(1e-60).sqrt()
            inverse = 1.0 / k
            share = inverse * rho  # ρ/k
            along = (ball.least * inverse).where(inside, share * inverse * inverse)
            outward = _Eight(builder, _ZEROS).where(inside, (rho - share) / (rho * rho))
            d = ((k - 1.0) * ball.least).where(inside, rho - share)
            place = code.plus(values[8], at)
            code.store(d, 7, place)
            for j in range(3):
                g = ball.axes[0][j] * y[0] + ball.axes[1][j] * y[1] + ball.axes[2][j] * y[2]
                row = code.plus(place, code.times(values[2], j + 1))
                code.store(along * g + outward * out[j], 7, row)

    return signature, generate


def _exp(x):
    """Return eˣ for x ≤ 0: 2ⁿ eʳ with |r| ≤ ln 2 / 2, to the last bit or two."""
    x = x.at_least(-700.0)
    n = (x * (1.0 / math.log(2.0))).rounded()
    r = x - n * 0.6931471803691238
    r = r - n * 1.9082149292705877e-10
    total = _Eight(x.builder, _ZEROS) + 1.0 / math.factorial(13)
    for i in range(12, -1, -1):
        total = total * r + 1.0 / math.factorial(i)
    builder = x.builder
    power = builder.add(builder.fptosi(n.value, _LONGS), ir.Constant(_LONGS, [1023] * LANES))
    power = builder.bitcast(builder.shl(power, ir.Constant(_LONGS, [52] * LANES)), _DOUBLES)
    return total * _Eight(builder, power)


def _log(x):
    """Return log x for x ≥ 1: 2 artanh((m − 1)/(m + 1)) + n ln 2 with m in [0.7, 1.42)."""
    builder = x.builder
    bits = builder.bitcast(x.value, _LONGS)
    # n such that m = x 2⁻ⁿ is around 1: add the mantissa of √2's complement before taking the exponent
    shifted = builder.add(bits, ir.Constant(_LONGS, [0x3FF0000000000000 - 0x3FE6A09E667F3BCD] * LANES))
    n = builder.sub(
        builder.ashr(shifted, ir.Constant(_LONGS, [52] * LANES)), ir.Constant(_LONGS, [1023] * LANES)
    )
    m = _Eight(
        builder,
        builder.bitcast(builder.sub(bits, builder.shl(n, ir.Constant(_LONGS, [52] * LANES))), _DOUBLES),
    )
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    total = _Eight(builder, _ZEROS) + 1.0 / 21
    for i in range(19, -1, -2):
        total = total * z + 1.0 / i
    return s * total * 2.0 + _Eight(builder, builder.sitofp(n, _DOUBLES)) * math.log(2.0)


@intrinsic
def shares(typing, near, at_first, at_other, n, sharpness, share, at_share, total):
    """share = exp(−β (d_other − d_first)), added to total (8 n)."""
    signature = types.void(near, at_first, at_other, n, sharpness, share, at_share, total)

    def generate(context, builder, signature, values):
        code = _Code(context, builder, signature, values)
        beta = code.splat(values[4])
        with code.groups(values[3]) as at:
            gap = code.load(0, code.plus(values[1], at)) - code.load(0, code.plus(values[2], at))
            part = _exp(gap * beta)
            code.store(part, 5, code.plus(values[6], at))
            code.store(code.load(7, at) + part, 7, at)

    return signature, generate


@intrinsic
def merge(typing, near, at_first, n, sharpness, total, distance):
    """distance (8 n) = d_first − log(total)/β; total becomes its inverse."""
    signature = types.void(near, at_first, n, sharpness, total, distance)

    def generate(context, builder, signature, values):
        code = _Code(context, builder, signature, values)
        blur = 1.0 / code.splat(values[3])
        with code.groups(values[2]) as at:
            whole = code.load(4, at)
            code.store(code.load(0, code.plus(values[1], at)) - _log(whole) * blur, 5, at)
            code.store(1.0 / whole, 4, at)

    return signature, generate


@intrinsic
def twist_rows(typing, points, stride, n, reference, near, at_d, factor, rows, at_row):
    """Write factor · [n ; (X − o) × n] to six rows of `rows`, `stride` apart."""
    signature = types.void(points, stride, n, reference, near, at_d, factor, rows, at_row)

    def generate(context, builder, signature, values):
        code = _Code(context, builder, signature, values)
        zero = ir.Constant(_LONG, 0)
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
                code.store(
                    value, 7, code.plus(values[8], at, code.times(values[1], i))
                )

    return signature, generate


def _sums(code, n, pairs, read, out, first):
    """Store Σ over lanes and groups of the products in `pairs`; read(at) returns the rows they name."""
    builder = code.builder
    totals = []
    for _ in pairs:
        slot = cgutils.alloca_once(builder, _DOUBLES)
        builder.store(_ZEROS, slot)
        totals.append(slot)
    with code.groups(n) as at:
        rows = read(at)
        for slot, (i, j) in zip(totals, pairs, strict=True):
            old = _Eight(builder, builder.load(slot))
            builder.store((rows[i] * rows[j] + old).value, slot)
    for k, slot in enumerate(totals):
        code.set_scalar(
            _Eight(builder, builder.load(slot)).sum(), out, ir.Constant(_LONG, first + k)
        )


@intrinsic
def own_products(typing, rows, at_row, stride, n, residual, out):
    """out (27) = the upper half of R Rᵀ, row by row, and R r, for six rows R."""
    signature = types.void(rows, at_row, stride, n, residual, out)

    def generate(context, builder, signature, values):
        code = _Code(context, builder, signature, values)

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
        code = _Code(context, builder, signature, values)
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
