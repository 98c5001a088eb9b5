"""Compiled steps on one image row: paint a span, find runs, add a run to an ellipse's sums.

Written with fixed vectors of eight numbers, which any CPU's compiler splits as it needs: left to itself, LLVM does not
vectorise loops as short as these.
"""

from __future__ import annotations

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

BLOCK = 8
"""Pixels painted at a time; blocks start at multiples of it."""
PADDING = 2 * BLOCK
"""Pixels behind the last one that may be read or written."""
NUMBERS = 1024
"""The last 10 bits of a painted value say who painted it: 0 nobody, e + 1, or E + 1 for saturated pixels."""
MOMENTS = 24
"""Sums per ellipse: 15 of x^i y^j (i + j ≤ 4), in the order of `_unpack`; from 16 on 6 of Z x^i y^j (i + j ≤ 2)."""

_BITS_OF_TWO = 0x4000000000000000  # the float64 2.0: above every value that is not saturated
# set bits
_PLACES = np.array(
    [sorted(range(8), key=lambda i: (not m >> i & 1, i)) for m in range(256)], np.uint8
)

_DOUBLE, _LONG = ir.DoubleType(), ir.IntType(64)
_DOUBLES, _LONGS = ir.VectorType(_DOUBLE, 8), ir.VectorType(_LONG, 8)
_FUSE = ("contract",)


def _pointer(context, builder, array_type, array, index, element):
    """Return the address of an array's flat element, as a pointer to `element`."""
    assert array_type.layout == "C"
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), element.as_pointer())


def _load(context, builder, array_type, array, index, element=_DOUBLES):
    return builder.load(_pointer(context, builder, array_type, array, index, element), align=1)


def _store(context, builder, value, array_type, array, index):
    builder.store(value, _pointer(context, builder, array_type, array, index, value.type), align=1)


def _splat(builder, scalar):
    vector = ir.VectorType(scalar.type, 8)
    one = builder.insert_element(
        ir.Constant(vector, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0)
    )
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), 8), [0] * 8))


def _pick(builder, vector, lanes):
    """Return a vector of eight from the given lanes."""
    return builder.shuffle_vector(
        vector, vector, ir.Constant(ir.VectorType(ir.IntType(32), 8), lanes)
    )


def _fused(builder, a, b, c):
    return builder.fadd(builder.fmul(a, b, flags=_FUSE), c, flags=_FUSE)


@intrinsic
def _paint_block(typing, buffer, u, centre, top, bend, limit, number, full):
    """buffer[u : u + 8] = max(itself, top − bend (u − centre)², with `number` in its last bits; `full` from limit on)."""
    signature = types.void(buffer, u, centre, top, bend, limit, number, full)

    def generate(context, builder, signature, values):
        array, at, middle, highest, bent, most, who, saturated = values
        steps = ir.Constant(_DOUBLES, [float(i) for i in range(8)])
        x = builder.fadd(_splat(builder, builder.fsub(builder.sitofp(at, _DOUBLE), middle)), steps)
        value = builder.fsub(
            _splat(builder, highest),
            builder.fmul(builder.fmul(x, x), _splat(builder, bent), flags=_FUSE),
            flags=_FUSE,
        )
        bits = builder.and_(builder.bitcast(value, _LONGS), ir.Constant(_LONGS, [-NUMBERS] * 8))
        bits = builder.or_(bits, _splat(builder, who))
        above = builder.fcmp_ordered(">=", value, _splat(builder, most))
        bits = builder.select(above, _splat(builder, saturated), bits)
        packed = builder.bitcast(bits, _DOUBLES)
        old = _load(context, builder, signature.args[0], array, at)
        # as a comparison this becomes a masked store, and the next ellipse's load must wait for it
        kind = ir.FunctionType(_DOUBLES, [_DOUBLES, _DOUBLES])
        maximum = cgutils.get_or_insert_function(builder.module, kind, "llvm.maxnum.v8f64")
        larger = builder.call(maximum, [packed, old], fastmath=("nnan",))
        _store(context, builder, larger, signature.args[0], array, at)

    return signature, generate


@intrinsic
def _changes(typing, buffer, u, keep, places, starts, n):
    """Write to starts[n:] the pixels u + i whose number differs from the pixel before; return n + how many."""
    signature = types.int64(buffer, u, keep, places, starts, n)

    def generate(context, builder, signature, values):
        array, at, kept, table, out, count = values
        here = builder.bitcast(_load(context, builder, signature.args[0], array, at), _LONGS)
        before_at = builder.sub(at, ir.Constant(_LONG, 1))
        before = builder.bitcast(
            _load(context, builder, signature.args[0], array, before_at), _LONGS
        )
        differs = builder.and_(builder.xor(here, before), ir.Constant(_LONGS, [NUMBERS - 1] * 8))
        flags = builder.icmp_unsigned("!=", differs, ir.Constant(_LONGS, [0] * 8))
        mask = builder.and_(builder.zext(builder.bitcast(flags, ir.IntType(8)), _LONG), kept)
        entry = builder.mul(mask, ir.Constant(_LONG, 8))
        bytes8 = ir.VectorType(ir.IntType(8), 8)
        offsets = builder.zext(
            _load(context, builder, signature.args[3], table, entry, bytes8), _LONGS
        )
        _store(
            context,
            builder,
            builder.add(offsets, _splat(builder, at)),
            signature.args[4],
            out,
            count,
        )
        return builder.add(count, builder.ctpop(mask))

    return signature, generate


@intrinsic
def number_at(typing, buffer, u):
    """Return who painted pixel u."""
    signature = types.int64(buffer, u)

    def generate(context, builder, signature, values):
        bits = _load(context, builder, signature.args[0], values[0], values[1], _LONG)
        return builder.and_(bits, ir.Constant(_LONG, NUMBERS - 1))

    return signature, generate


@intrinsic
def _add_powers(typing, moments, k, powers, a, b, heights, y):
    """moments[k:] += the powers of x between a and b times powers of y. All places are flat indices."""
    signature = types.void(moments, k, powers, a, b, heights, y)

    def generate(context, builder, signature, values):
        x = _powers_between(context, builder, signature.args[2], *values[2:5])
        for shift, lanes in ((0, [0, 1, 2, 3, 4, 0, 1, 2]), (8, [3, 0, 1, 2, 0, 1, 0, 5])):
            _add_scaled(context, builder, signature, values, shift, _pick(builder, x, lanes))

    return signature, generate


@intrinsic
def _add_seen(typing, moments, k, powers, a, b, heights, y, value):
    """The same for an observation that is `value` all along: Z x^i y^j, from moments[k + 16] on."""
    signature = types.void(moments, k, powers, a, b, heights, y, value)

    def generate(context, builder, signature, values):
        x = _powers_between(context, builder, signature.args[2], *values[2:5])
        seen = builder.fmul(_pick(builder, x, [0, 1, 2, 0, 1, 0, 5, 5]), _splat(builder, values[7]))
        _add_scaled(context, builder, signature, values, 16, seen)

    return signature, generate


def _powers_between(context, builder, array_type, powers, a, b):
    right, left = (_load(context, builder, array_type, powers, at) for at in (b, a))
    return builder.fsub(right, left)


def _add_scaled(context, builder, signature, values, shift, x):
    """moments[k + shift:] += heights[y + shift:] · x"""
    out, at, height, row = values[0], values[1], values[5], values[6]
    place = builder.add(at, ir.Constant(_LONG, shift))
    factor_at = builder.add(row, ir.Constant(_LONG, shift))
    factor = _load(context, builder, signature.args[5], height, factor_at)
    old = _load(context, builder, signature.args[0], out, place)
    _store(context, builder, _fused(builder, factor, x, old), signature.args[0], out, place)


@numba.njit(cache=True, nogil=True)
def paint(buffer, lo, hi, centre, top, bend, limit, number, core):  # pragma: no cover - compiled
    """Raise buffer over [lo, hi) to top − bend (u − centre)² where that is more, in the name of `number` (or `core`).

    Whole blocks are written: outside its own span a value is negative and never wins; outside the observed span
    nobody looks.
    """
    full = _BITS_OF_TWO | core
    for u in range(lo // BLOCK * BLOCK, hi, BLOCK):
        _paint_block(buffer, u, centre, top, bend, limit, number, full)


@numba.njit(cache=True, nogil=True)
def find_runs(buffer, lo, hi, starts):  # pragma: no cover - compiled
    """Fill starts with the first pixel of each run of equal numbers in [lo, hi), and hi; return how many runs."""
    starts[0] = lo
    n = 1
    for u in range(lo + 1, hi, BLOCK):
        n = _changes(buffer, u, 255 >> max(0, u + BLOCK - hi), _PLACES, starts, n)
    starts[n] = hi
    return n


@numba.njit(cache=True, nogil=True)
def clear(buffer, lo, hi):  # pragma: no cover - compiled
    """Forget what was painted over [lo, hi)."""
    buffer[lo // BLOCK * BLOCK : hi + BLOCK] = 0.0


@numba.njit(cache=True, nogil=True)
def add_run(moments, k, powers, a, b, heights, y):  # pragma: no cover - compiled
    """Add to moments[k] a run: rows a and b of `powers`, row y of `heights`."""
    _add_powers(moments, k * MOMENTS, powers, a * 8, b * 8, heights, y * MOMENTS)


@numba.njit(cache=True, nogil=True)
def add_seen(moments, k, powers, a, b, heights, y, value):  # pragma: no cover - compiled
    """Add to moments[k] a piece of a run over which the observation is `value`."""
    _add_seen(moments, k * MOMENTS, powers, a * 8, b * 8, heights, y * MOMENTS, value)
