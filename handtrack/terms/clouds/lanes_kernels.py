"""Vector code by hand: eight numbers at a time, which any CPU's compiler splits as it needs.

Python here writes LLVM's instructions while an intrinsic is compiled. Where many arrays might overlap, LLVM does not
vectorise loops by itself.
"""

from __future__ import annotations

import math

from llvmlite import ir
from numba.core import cgutils

LANES = 8
DOUBLE, LONG = ir.DoubleType(), ir.IntType(64)
DOUBLES, LONGS = ir.VectorType(DOUBLE, LANES), ir.VectorType(LONG, LANES)
ZEROS = ir.Constant(DOUBLES, [0.0] * LANES)
_FUSE = ("contract",)


class Eight:
    """Eight numbers in the code being written; arithmetic appends instructions."""

    def __init__(self, builder, value):
        self.builder, self.value = builder, value

    def _lift(self, other):
        if isinstance(other, Eight):
            return other.value
        return ir.Constant(DOUBLES, [float(other)] * LANES)

    def __add__(self, other):
        return Eight(self.builder, self.builder.fadd(self.value, self._lift(other), flags=_FUSE))

    def __sub__(self, other):
        return Eight(self.builder, self.builder.fsub(self.value, self._lift(other), flags=_FUSE))

    def __mul__(self, other):
        return Eight(self.builder, self.builder.fmul(self.value, self._lift(other), flags=_FUSE))

    def __truediv__(self, other):
        return Eight(self.builder, self.builder.fdiv(self.value, self._lift(other)))

    def __rtruediv__(self, other):
        return Eight(self.builder, self.builder.fdiv(self._lift(other), self.value))

    def __lt__(self, other):
        return self.builder.fcmp_ordered("<", self.value, self._lift(other))

    def _call(self, name, *others):
        kind = ir.FunctionType(DOUBLES, [DOUBLES] * (1 + len(others)))
        function = cgutils.get_or_insert_function(self.builder.module, kind, f"llvm.{name}.v8f64")
        return Eight(
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
        return Eight(self.builder, self.builder.select(mask, self.value, self._lift(other)))

    def sum(self):
        """Return the scalar sum, always in the same order."""
        return self._reduced("fadd", [ir.Constant(DOUBLE, -0.0)], ("reassoc",))

    def largest(self):
        """Return the largest number."""
        return self._reduced("fmax", [], ("nnan",))

    def _reduced(self, name, first, flags):
        kind = ir.FunctionType(DOUBLE, [*(x.type for x in first), DOUBLES])
        function = cgutils.get_or_insert_function(
            self.builder.module, kind, f"llvm.vector.reduce.{name}.v8f64"
        )
        return self.builder.call(function, [*first, self.value], fastmath=flags)


class Code:
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
        return Eight(self.builder, self.builder.load(self._pointer(array, index, DOUBLES), align=1))

    def store(self, value, array, index):
        self.builder.store(value.value, self._pointer(array, index, DOUBLES), align=1)

    def scalar(self, array, index, shift=0):
        at = self.builder.add(index, ir.Constant(LONG, shift))
        return self.splat(self.builder.load(self._pointer(array, at, DOUBLE)))

    def set_scalar(self, value, array, index):
        self.builder.store(value, self._pointer(array, index, DOUBLE))

    def splat(self, value):
        one = self.builder.insert_element(
            ir.Constant(DOUBLES, ir.Undefined), value, ir.Constant(ir.IntType(32), 0)
        )
        lanes = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return Eight(self.builder, self.builder.shuffle_vector(one, one, lanes))

    def times(self, a, b):
        return self.builder.mul(a, b if not isinstance(b, int) else ir.Constant(LONG, b))

    def plus(self, *parts):
        total = parts[0]
        for part in parts[1:]:
            total = self.builder.add(
                total, part if not isinstance(part, int) else ir.Constant(LONG, part)
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


class Anywhere:
    """Whether a condition held in any lane of any group."""

    def __init__(self, code):
        self.builder = code.builder
        bits = ir.VectorType(ir.IntType(1), LANES)
        self.slot = cgutils.alloca_once(code.builder, bits)
        code.builder.store(ir.Constant(bits, [0] * LANES), self.slot)

    def note(self, mask):
        found = self.builder.or_(self.builder.load(self.slot), mask)
        self.builder.store(found, self.slot)

    def answer(self):
        packed = self.builder.bitcast(self.builder.load(self.slot), ir.IntType(8))
        return self.builder.icmp_unsigned("!=", packed, ir.Constant(ir.IntType(8), 0))


def exp(x):
    """Return eˣ for x ≤ 0: 2ⁿ eʳ with |r| ≤ ln 2 / 2, to the last bit or two."""
    x = x.at_least(-700.0)
    n = (x * (1.0 / math.log(2.0))).rounded()
    r = x - n * 0.6931471803691238
    r = r - n * 1.9082149292705877e-10
    total = Eight(x.builder, ZEROS) + 1.0 / math.factorial(13)
    for i in range(12, -1, -1):
        total = total * r + 1.0 / math.factorial(i)
    builder = x.builder
    power = builder.add(builder.fptosi(n.value, LONGS), ir.Constant(LONGS, [1023] * LANES))
    power = builder.bitcast(builder.shl(power, ir.Constant(LONGS, [52] * LANES)), DOUBLES)
    return total * Eight(builder, power)


def log(x):
    """Return log x for x ≥ 1: 2 artanh((m − 1)/(m + 1)) + n ln 2 with m in [0.7, 1.42)."""
    builder = x.builder
    bits = builder.bitcast(x.value, LONGS)
    # n such that m = x 2⁻ⁿ is around 1: add the mantissa of √2's complement before taking the exponent
    shifted = builder.add(
        bits, ir.Constant(LONGS, [0x3FF0000000000000 - 0x3FE6A09E667F3BCD] * LANES)
    )
    n = builder.sub(
        builder.ashr(shifted, ir.Constant(LONGS, [52] * LANES)),
        ir.Constant(LONGS, [1023] * LANES),
    )
    m = Eight(
        builder,
        builder.bitcast(
            builder.sub(bits, builder.shl(n, ir.Constant(LONGS, [52] * LANES))), DOUBLES
        ),
    )
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    total = Eight(builder, ZEROS) + 1.0 / 21
    for i in range(19, -1, -2):
        total = total * z + 1.0 / i
    return s * total * 2.0 + Eight(builder, builder.sitofp(n, DOUBLES)) * math.log(2.0)
