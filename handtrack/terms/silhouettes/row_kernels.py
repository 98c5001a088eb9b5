"""Compiled steps on one image row: mark what is saturated, paint the rest, find runs, add a run to an ellipse's sums.

Written with fixed vectors of eight numbers, which any CPU's compiler splits as it needs: left to itself, LLVM does not
vectorise loops as short as these.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from handtrack.compiled import compiled

BLOCK = 8
"""Pixels painted at a time; blocks start at multiples of it."""
PADDING = 2 * BLOCK
"""Pixels before the first and behind the last one that may be read or written."""
WORD = 64
"""Bits of a number of marks: pixels that are saturated, blocks that are not so throughout."""
SUMS = 8
"""Sums of a row: Σ x⁰ … Σ x⁴, Σ Z x⁰ … Σ Z x²."""
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
def _begin_block(typing, buffer, u, is_open, full):
    """buffer[u : u + 8] = 0 if is_open, else `full`."""
    signature = types.void(buffer, u, is_open, full)

    def generate(context, builder, signature, values):
        array, at, opened, saturated = values
        flag = builder.icmp_unsigned("!=", opened, ir.Constant(_LONG, 0))
        bits = builder.select(flag, ir.Constant(_LONG, 0), saturated)
        _store(context, builder, _splat(builder, bits), signature.args[0], array, at)

    return signature, generate


@intrinsic
def _mark(typing, marks, word, lo, hi):
    """Set bits lo to hi − 1 of the 512 from marks[word] on; either may lie beyond them."""
    signature = types.void(marks, word, lo, hi)

    def generate(context, builder, signature, values):
        array, at, begin, end = values
        ends = []
        for place in (begin, end):  # bits below it, in each word
            base = ir.Constant(_LONGS, [WORD * i for i in range(8)])
            inside = builder.sub(_splat(builder, place), base)
            above = builder.icmp_signed(">=", inside, ir.Constant(_LONGS, [WORD] * 8))
            below = builder.icmp_signed("<=", inside, ir.Constant(_LONGS, [0] * 8))
            kept = builder.and_(inside, ir.Constant(_LONGS, [WORD - 1] * 8))
            open_ = builder.shl(ir.Constant(_LONGS, [-1] * 8), kept)
            open_ = builder.select(above, ir.Constant(_LONGS, [0] * 8), open_)
            ends.append(builder.select(below, ir.Constant(_LONGS, [-1] * 8), open_))
        between = builder.and_(ends[0], builder.not_(ends[1]))
        old = _load(context, builder, signature.args[0], array, at, _LONGS)
        _store(context, builder, builder.or_(old, between), signature.args[0], array, at)

    return signature, generate


@intrinsic
def _take_open_blocks(typing, marks, word):
    """Return a bit for each of 64 blocks: whether one of its 8 marks, from marks[word] on, is missing. Marks are taken away."""
    signature = types.int64(marks, word)

    def generate(context, builder, signature, values):
        found = _load(context, builder, signature.args[0], *values, _LONGS)
        nothing = ir.Constant(_LONGS, [0] * 8)
        _store(context, builder, nothing, signature.args[0], *values)
        many = ir.VectorType(ir.IntType(8), WORD)
        missing = builder.icmp_unsigned(
            "!=", builder.bitcast(found, many), ir.Constant(many, [255] * WORD)
        )
        return builder.bitcast(missing, _LONG)

    return signature, generate


@intrinsic
def _first(typing, bits):
    """Return the place of the lowest bit that is set."""

    def generate(context, builder, signature, values):
        return builder.cttz(values[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), generate


@intrinsic
def _changes(typing, buffer, u, edges, byte, keep, places, starts, n):
    """Write to starts[n:] the pixels u + i, marked in edges[byte] or with another number than the pixel before; return n + how many."""
    signature = types.int64(buffer, u, edges, byte, keep, places, starts, n)

    def generate(context, builder, signature, values):
        array, at, marked, marks_at, kept, table, out, count = values
        here = builder.bitcast(_load(context, builder, signature.args[0], array, at), _LONGS)
        before_at = builder.sub(at, ir.Constant(_LONG, 1))
        before = builder.bitcast(
            _load(context, builder, signature.args[0], array, before_at), _LONGS
        )
        differs = builder.and_(builder.xor(here, before), ir.Constant(_LONGS, [NUMBERS - 1] * 8))
        flags = builder.icmp_unsigned("!=", differs, ir.Constant(_LONGS, [0] * 8))
        mark = _load(context, builder, signature.args[2], marked, marks_at, ir.IntType(8))
        both = builder.or_(builder.bitcast(flags, ir.IntType(8)), mark)
        mask = builder.and_(builder.zext(both, _LONG), kept)
        entry = builder.mul(mask, ir.Constant(_LONG, 8))
        bytes8 = ir.VectorType(ir.IntType(8), 8)
        offsets = builder.zext(
            _load(context, builder, signature.args[5], table, entry, bytes8), _LONGS
        )
        moved = builder.add(offsets, _splat(builder, at))
        _store(context, builder, moved, signature.args[6], out, count)
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
def _add_run(typing, sums, k, powers, a, b, value):
    """sums[k:] += the powers of x between a and b, the last three times value. All places are flat indices."""
    signature = types.void(sums, k, powers, a, b, value)

    def generate(context, builder, signature, values):
        out, at, table, begin, end, seen = values
        right, left = (
            _load(context, builder, signature.args[2], table, place) for place in (end, begin)
        )
        between = builder.fsub(right, left)
        lanes = ir.Constant(ir.VectorType(ir.IntType(32), 8), [0, 1, 2, 3, 4, 8, 8, 8])
        once = ir.Constant(_DOUBLES, [1.0] * 8)
        factor = builder.shuffle_vector(once, _splat(builder, seen), lanes)
        old = _load(context, builder, signature.args[0], out, at)
        _store(context, builder, _fused(builder, between, factor, old), signature.args[0], out, at)

    return signature, generate


@intrinsic
def _move_sums(typing, moments, k, sums, s, heights, y):
    """moments[k:] += sums[s:] times powers of y; sums[s:] = 0. All places are flat indices."""
    signature = types.void(moments, k, sums, s, heights, y)

    def generate(context, builder, signature, values):
        out, at, kept, from_at, height, row = values
        x = _load(context, builder, signature.args[2], kept, from_at)
        nothing = ir.Constant(_DOUBLES, [0.0] * 8)
        _store(context, builder, nothing, signature.args[2], kept, from_at)
        columns = (0, 1, 2, 3, 4, 0, 1, 2), (3, 0, 1, 2, 0, 1, 0, 0), (5, 6, 7, 5, 6, 5, 5, 5)
        for n, lanes in enumerate(columns):
            shift = ir.Constant(_LONG, 8 * n)
            place = builder.add(at, shift)
            factor = _load(context, builder, signature.args[4], height, builder.add(row, shift))
            old = _load(context, builder, signature.args[0], out, place)
            new = _fused(builder, factor, _pick(builder, x, lanes), old)
            _store(context, builder, new, signature.args[0], out, place)

    return signature, generate


@compiled
def mark(marks, lo, hi):  # pragma: no cover - compiled
    """Set the bits lo to hi − 1 of the numbers `marks`; none if lo ≥ hi."""
    for word in range(lo // (WORD * BLOCK), (hi - 1) // (WORD * BLOCK) + 1):
        _mark(marks, BLOCK * word, lo - BLOCK * WORD * word, hi - BLOCK * WORD * word)


@compiled
def begin_row(buffer, lo, hi, marks, opened, core):  # pragma: no cover - compiled
    """Fill the blocks of [lo, hi): in the name of `core` where all pixels are marked, else with nothing.

    Bits of `opened` say which are to be painted. The marks are taken away.
    """
    full = _BITS_OF_TWO | core
    for word in range(lo // (BLOCK * WORD), (hi - 1) // (BLOCK * WORD) + 1):
        bits = _take_open_blocks(marks, BLOCK * word)
        opened[word] = bits
        first = max(lo // BLOCK, WORD * word)
        last = min((hi - 1) // BLOCK, WORD * word + WORD - 1)
        bits >>= first - WORD * word
        for block in range(first, last + 1):
            _begin_block(buffer, BLOCK * block, bits & 1, full)
            bits >>= 1


@compiled
def paint(
    buffer, lo, hi, opened, centre, top, bend, limit, number, core
):  # pragma: no cover - compiled
    """Raise the open blocks of [lo, hi) to top − bend (u − centre)² where that is more, in the name of `number` (or `core`).

    Whole blocks are written: outside its own span a value is negative and never wins; outside the observed span
    nobody looks.
    """
    full = _BITS_OF_TWO | core
    first, last = lo // BLOCK, (hi - 1) // BLOCK
    for word in range(first // WORD, last // WORD + 1):
        bits = opened[word] & (-1 << max(first - WORD * word, 0))
        bits &= ~(-2 << min(last - WORD * word, WORD - 1))
        while bits != 0:
            u = BLOCK * (WORD * word + _first(bits))
            bits &= bits - 1
            _paint_block(buffer, u, centre, top, bend, limit, number, full)


@compiled
def find_runs(buffer, lo, hi, edges, row, starts):  # pragma: no cover - compiled
    """Fill starts with the first pixel of each run in [lo, hi), and hi; return how many runs.

    A run ends where the painter changes, or the observation: edges[row + u // 8] has a bit for each pixel.
    """
    starts[0] = lo
    n = 1
    for block in range(lo // BLOCK, (hi - 1) // BLOCK + 1):
        u = BLOCK * block
        keep = (255 << max(0, lo + 1 - u)) & (255 >> max(0, u + BLOCK - hi))
        n = _changes(buffer, u, edges, row + block, keep, _PLACES, starts, n)
    starts[n] = hi
    return n


@compiled
def add_run(sums, k, powers, a, b, value):  # pragma: no cover - compiled
    """Add to sums[k] a run over which the observation is `value`: rows a and b of `powers`."""
    _add_run(sums, k * SUMS, powers, a * SUMS, b * SUMS, value)


@compiled
def move_sums(moments, sums, k, heights, y):  # pragma: no cover - compiled
    """Add a row's sums[k] to moments[k] at height y, and forget them."""
    _move_sums(moments, k * MOMENTS, sums, k * SUMS, heights, y * MOMENTS)
