"""Vector code by hand: eight numbers at a time, which any CPU's compiler splits as it needs.

Python here writes LLVM's instructions while an intrinsic is compiled. Where many arrays might overlap, or loops are short, LLVM
does not vectorise by itself.
"""

from __future__ import annotations

import math
from contextlib import contextmanager
from inspect import signature

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

LANES = 8
DOUBLE, LONG, BYTE = ir.DoubleType(), ir.IntType(64), ir.IntType(8)
DOUBLES, LONGS = ir.VectorType(DOUBLE, LANES), ir.VectorType(LONG, LANES)
ZEROS = ir.Constant(DOUBLES, [0.0] * LANES)
_FUSE = ("contract",)


def written(result):
    """Make a function that others compile with, of one that writes its code and gets `Code`,
    `Memory` for arrays and values.

    Parameters
    ----------
    result
        The type that it returns.
    """

    def made(write):
        def typed(typing, *kinds):
            def generate(context, builder, own, values):
                code = Code(context, builder)
                return write(code, *map(code.argument, own.args, values))

            return result(*kinds), generate

        typed.__name__, typed.__signature__ = write.__name__, signature(write)
        return intrinsic(typed)

    return made


class Eight:
    """Eight numbers in the code being written; arithmetic appends instructions."""

    def __init__(self, builder, value):
        self.builder, self.value = builder, value

    def _lift(self, other):
        if isinstance(other, Eight):
            return other.value
        return ir.Constant(self.value.type, [other] * LANES)

    def __add__(self, other):
        return Eight(self.builder, self.builder.fadd(self.value, self._lift(other), flags=_FUSE))

    def plus(self, other):
        """Return the sum, rounded as scalar code does: products are not fused with it."""
        return Eight(self.builder, self.builder.fadd(self.value, other.value))

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

    def __and__(self, other):
        return Eight(self.builder, self.builder.and_(self.value, self._lift(other)))

    def __or__(self, other):
        return Eight(self.builder, self.builder.or_(self.value, self._lift(other)))

    def _call(self, name, *others, flags=()):
        kind = ir.FunctionType(DOUBLES, [DOUBLES] * (1 + len(others)))
        function = cgutils.get_or_insert_function(self.builder.module, kind, f"llvm.{name}.v8f64")
        values = [self.value, *map(self._lift, others)]
        return Eight(self.builder, self.builder.call(function, values, fastmath=flags))

    def sqrt(self):
        return self._call("sqrt")

    def at_least(self, other, flags=()):
        return self._call("maxnum", other, flags=flags)

    def rounded(self):
        return self._call("rint")

    def bits_as(self, kind):
        """Return the same bits as vectors of another kind."""
        return Eight(self.builder, self.builder.bitcast(self.value, kind))

    def picked(self, lanes):
        """Return the numbers of the given lanes."""
        mask = ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), lanes)
        return Eight(self.builder, self.builder.shuffle_vector(self.value, self.value, mask))

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


class Memory:
    """An array, by flat places; `row` counts rows of its last axis."""

    def __init__(self, code, data, width):
        self.code, self.data, self.width = code, data, width

    @classmethod
    def of(cls, code, kind, value):
        assert kind.layout == "C", kind
        array = code.context.make_array(kind)(code.context, code.builder, value)
        return cls(code, array.data, cgutils.unpack_tuple(code.builder, array.shape)[-1])

    def row(self, number):
        """Return what begins with a row."""
        start = self.code.times(number, self.width)
        return Memory(self.code, self.code.builder.gep(self.data, [start]), self.width)

    @property
    def eight(self):
        """Eight of its numbers."""
        return ir.VectorType(self.data.type.pointee, LANES)

    def _pointer(self, at, row, kind):
        builder = self.code.builder
        place = self.code.plus(at, self.code.times(self.width, row)) if row else at
        return builder.bitcast(builder.gep(self.data, [place]), kind.as_pointer())

    def load(self, at, row=0, kind=DOUBLES):
        builder = self.code.builder
        return Eight(builder, builder.load(self._pointer(at, row, kind), align=1))

    def store(self, eight, at, row=0):
        pointer = self._pointer(at, row, eight.value.type)
        self.code.builder.store(eight.value, pointer, align=1)

    def scalar(self, at):
        """Return one number eight times."""
        place = ir.Constant(LONG, at)
        return self.code.splat(self.code.builder.load(self._pointer(place, 0, DOUBLE)))

    def set_scalar(self, value, at):
        self.code.builder.store(value, self._pointer(ir.Constant(LONG, at), 0, DOUBLE))


class Code:
    """The code that is being written."""

    def __init__(self, context, builder):
        self.context, self.builder = context, builder

    def argument(self, kind, value):
        """Return what a function is called with as code that is written takes it."""
        if isinstance(kind, types.BaseTuple):
            return tuple(map(self.argument, kind, cgutils.unpack_tuple(self.builder, value)))
        return Memory.of(self, kind, value) if isinstance(kind, types.Array) else value

    def splat(self, value):
        vector = ir.VectorType(value.type, LANES)
        one = self.builder.insert_element(
            ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0)
        )
        return Eight(self.builder, one).picked([0] * LANES)

    def highest(self):
        """Return a place for the highest numbers met, −∞ at first."""
        lowest = ir.Constant(DOUBLES, [-math.inf] * LANES)
        return cgutils.alloca_once_value(self.builder, lowest)

    def meet(self, highest, eight):
        """Keep the higher ones of eight numbers and of those at a place."""
        before = Eight(self.builder, self.builder.load(highest))
        self.builder.store(eight.at_least(before).value, highest)

    def largest(self, highest):
        """Return the largest number met."""
        return Eight(self.builder, self.builder.load(highest)).largest()

    def eight(self, numbers):
        """Return eight constants."""
        return Eight(self.builder, ir.Constant(DOUBLES, numbers))

    def long(self, number):
        return ir.Constant(LONG, number)

    def times(self, a, b):
        return self.builder.mul(a, b if not isinstance(b, int) else ir.Constant(LONG, b))

    def plus(self, *parts):
        total = parts[0]
        for part in parts[1:]:
            total = self.builder.add(
                total, part if not isinstance(part, int) else ir.Constant(LONG, part)
            )
        return total

    @contextmanager
    def groups(self, n):
        """Yield the flat place 8 g of each group g < n."""
        with cgutils.for_range(self.builder, n) as loop:
            yield self.times(loop.index, LANES)


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
    power = builder.add(builder.fptosi(n.value, LONGS), _longs(1023))
    return total * Eight(builder, builder.shl(power, _longs(52))).bits_as(DOUBLES)


def log(x):
    """Return log x for x ≥ 1: 2 artanh((m − 1)/(m + 1)) + n ln 2 with m in [0.7, 1.42)."""
    builder = x.builder
    bits = x.bits_as(LONGS).value
    # n such that m = x 2⁻ⁿ is around 1: add the mantissa of √2's complement before taking the exponent
    shifted = builder.add(bits, _longs(0x3FF0000000000000 - 0x3FE6A09E667F3BCD))
    n = builder.sub(builder.ashr(shifted, _longs(52)), _longs(1023))
    m = Eight(builder, builder.sub(bits, builder.shl(n, _longs(52)))).bits_as(DOUBLES)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    total = Eight(builder, ZEROS) + 1.0 / 21
    for i in range(19, -1, -2):
        total = total * z + 1.0 / i
    return s * total * 2.0 + Eight(builder, builder.sitofp(n, DOUBLES)) * math.log(2.0)


def _longs(number):
    return ir.Constant(LONGS, [number] * LANES)
