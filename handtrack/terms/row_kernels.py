"""Compiled steps on one image row: mark what is saturated, paint the rest, find runs, add a run to an ellipse's sums.

Written with fixed vectors of eight numbers, which any CPU's compiler splits as it needs: left to itself, LLVM does not
vectorise loops as short as these.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba.core import types

from handtrack.compiled import compiled
from handtrack.terms.lanes_kernels import BYTE, DOUBLE, LANES, LONG, LONGS, ZEROS, Eight, written

BLOCK = LANES
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

_NOTHING = ir.Constant(LONGS, [0] * LANES)


@written(types.void)
def _paint_block(code, buffer, u, parabola, limit, number, full):
    """buffer[u : u + 8] = max(itself, top − bend (u − centre)², with `number` in its last bits; `full` from limit on)."""
    builder = code.builder
    centre, top, bend = parabola
    steps = code.eight([float(i) for i in range(LANES)])
    x = code.splat(builder.fsub(builder.sitofp(u, DOUBLE), centre)) + steps
    value = code.splat(top) - x * x * code.splat(bend)
    bits = (value.bits_as(LONGS) & -NUMBERS) | code.splat(number)
    above = builder.fcmp_ordered(">=", value.value, code.splat(limit).value)
    packed = code.splat(full).where(above, bits).bits_as(ZEROS.type)
    # as a comparison this becomes a masked store, and the next ellipse's load must wait for it
    buffer.store(packed.at_least(buffer.load(u), flags=("nnan",)), u)


@written(types.void)
def _begin_block(code, buffer, u, is_open, full):
    """buffer[u : u + 8] = 0 if is_open, else `full`."""
    zero = ir.Constant(LONG, 0)
    flag = code.builder.icmp_unsigned("!=", is_open, zero)
    buffer.store(code.splat(code.builder.select(flag, zero, full)), u)


@written(types.void)
def _mark(code, marks, word, lo, hi):
    """Set bits lo to hi − 1 of the 512 from marks[word] on; either may lie beyond them."""
    builder, ends = code.builder, []
    for place in (lo, hi):  # bits below it, in each word
        base = ir.Constant(LONGS, [WORD * i for i in range(LANES)])
        inside = builder.sub(code.splat(place).value, base)
        above = builder.icmp_signed(">=", inside, ir.Constant(LONGS, [WORD] * LANES))
        below = builder.icmp_signed("<=", inside, _NOTHING)
        kept = builder.and_(inside, ir.Constant(LONGS, [WORD - 1] * LANES))
        every = ir.Constant(LONGS, [-1] * LANES)
        open_ = builder.select(above, _NOTHING, builder.shl(every, kept))
        ends.append(builder.select(below, every, open_))
    between = builder.and_(ends[0], builder.not_(ends[1]))
    marks.store(marks.load(word, kind=LONGS) | Eight(builder, between), word)


@written(types.int64)
def _take_open_blocks(code, marks, word):
    """Return a bit for each of 64 blocks: whether one of its 8 marks, from marks[word] on, is missing. Marks are taken away."""
    found = marks.load(word, kind=LONGS)
    marks.store(Eight(code.builder, _NOTHING), word)
    many = ir.VectorType(BYTE, WORD)
    whole = ir.Constant(many, [255] * WORD)
    return code.builder.bitcast(
        code.builder.icmp_unsigned("!=", found.bits_as(many).value, whole), LONG
    )


@written(types.int64)
def _first(code, bits):
    """Return the place of the lowest bit that is set."""
    return code.builder.cttz(bits, ir.Constant(ir.IntType(1), 1))


@written(types.int64)
def _changes(code, buffer, u, marked, keep, places, starts, n):
    """Write to starts[n:] the pixels u + i, marked (a bit each) or with another number than the pixel before; return n + how many."""
    builder = code.builder
    here, before = (buffer.load(at, kind=LONGS) for at in (u, builder.sub(u, ir.Constant(LONG, 1))))
    differs = Eight(builder, builder.xor(here.value, before.value)) & (NUMBERS - 1)
    flags = builder.bitcast(builder.icmp_unsigned("!=", differs.value, _NOTHING), BYTE)
    mask = builder.and_(builder.or_(builder.zext(flags, LONG), marked), keep)
    bytes8 = ir.VectorType(BYTE, LANES)
    offsets = builder.zext(places.load(code.times(mask, LANES), kind=bytes8).value, LONGS)
    starts.store(Eight(builder, builder.add(offsets, code.splat(u).value)), n)
    return builder.add(n, builder.ctpop(mask))


@written(types.int64)
def number_at(code, buffer, u):
    """Return who painted pixel u."""
    return code.builder.and_(buffer.load(u, kind=LONG).value, ir.Constant(LONG, NUMBERS - 1))


@written(types.void)
def _add_run(code, sums, k, powers, a, b, value):
    """sums[k:] += the powers of x between a and b, the last three times value. All places are flat indices."""
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0, 1, 2, 3, 4, 8, 8, 8])
    once = code.eight([1.0] * LANES)
    factor = code.builder.shuffle_vector(once.value, code.splat(value).value, lanes)
    between = powers.load(b) - powers.load(a)
    sums.store(between * Eight(code.builder, factor) + sums.load(k), k)


@written(types.void)
def _move_sums(code, moments, k, sums, s, heights, y):
    """moments[k:] += sums[s:] times powers of y; sums[s:] = 0. All places are flat indices."""
    x = sums.load(s)
    sums.store(Eight(code.builder, ZEROS), s)
    columns = (0, 1, 2, 3, 4, 0, 1, 2), (3, 0, 1, 2, 0, 1, 0, 0), (5, 6, 7, 5, 6, 5, 5, 5)
    for n, lanes in enumerate(columns):
        place, row = (code.plus(at, LANES * n) for at in (k, y))
        moments.store(heights.load(row) * x.picked(lanes) + moments.load(place), place)


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
def paint(buffer, span, opened, parabola, limit, number, core):  # pragma: no cover - compiled
    """Raise the open blocks of a span [lo, hi) to a parabola top − bend (u − centre)², where that
    is more, in the name of `number` (or `core`).

    Whole blocks are written: outside its own span a value is negative and never wins; outside the
    observed span nobody looks.

    Parameters
    ----------
    parabola
        Centre, top and bend.
    """
    full = _BITS_OF_TWO | core
    first, last = span[0] // BLOCK, (span[1] - 1) // BLOCK
    for word in range(first // WORD, last // WORD + 1):
        bits = opened[word] & (-1 << max(first - WORD * word, 0))
        bits &= ~(-2 << min(last - WORD * word, WORD - 1))
        while bits != 0:
            u = BLOCK * (WORD * word + _first(bits))
            bits &= bits - 1
            _paint_block(buffer, u, parabola, limit, number, full)


@compiled
def find_runs(buffer, lo, hi, edges, starts):  # pragma: no cover - compiled
    """Fill starts with the first pixel of each run in [lo, hi), and hi; return how many runs.

    A run ends where the painter changes, or the observation: edges[u // 8] has a bit for each pixel.
    """
    starts[0] = lo
    n = 1
    for block in range(lo // BLOCK, (hi - 1) // BLOCK + 1):
        u = BLOCK * block
        keep = (255 << max(0, lo + 1 - u)) & (255 >> max(0, u + BLOCK - hi))
        n = _changes(buffer, u, np.int64(edges[block]), keep, _PLACES, starts, n)
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


# ---- Preparation of a mask: where its value changes along a row, and the pieces of one value in between


@written(types.int64)
def _differing(code, image, at):
    """Return a bit for each of 8 pixels of the flat image: whether it differs from the pixel before."""
    builder, before = code.builder, code.plus(at, -1)
    here, left = (image.load(place, kind=image.eight).value for place in (at, before))
    flags = builder.bitcast(builder.fcmp_unordered("!=", here, left), BYTE)
    return builder.zext(flags, LONG)


@compiled
def mark_edges(image, edges, begins):  # pragma: no cover - compiled
    """Fill edges (H, W // 8 + 1), a bit for each pixel that differs from the one before it in its row, and begins (H + 1,):
    how many pieces of one value the rows above have. Returns how many there are.
    """
    height, width = image.shape
    begins[0] = 0
    for v in range(height):
        pieces = 1
        for block in range(edges.shape[1]):
            u = BLOCK * block
            if u > 0 and u + BLOCK <= width:
                bits = _differing(image, v * width + u)
            else:
                bits = 0
                for i in range(max(u, 1), min(u + BLOCK, width)):
                    bits |= np.int64(image[v, i] != image[v, i - 1]) << (i - u)
            edges[v, block] = bits
            while bits != 0:
                bits &= bits - 1
                pieces += 1
        begins[v + 1] = begins[v] + pieces
    return begins[height]


@compiled
def fill_pieces(
    image, sign, valid, edges, begins, ends, values, energy
):  # pragma: no cover - compiled
    """Fill ends (K,), the column where each piece ends, values (K,), sign · image, and each row's ΣZ² (H,). Returns −ΣZ.

    Both sums are of observed pixels; where −Z is below 0, nobody knows.
    """
    height, width = image.shape
    area = 0.0
    for v in range(height):
        k = begins[v]
        for block in range(edges.shape[1]):
            bits = edges[v, block]
            for i in range(BLOCK):
                if bits == 0:
                    break
                if bits & 1:
                    ends[k] = BLOCK * block + i
                    k += 1
                bits >>= 1
        ends[k] = width
        energy[v] = 0.0
        left = 0
        for n in range(begins[v], k + 1):
            values[n] = sign * image[v, left]
            seen = min(ends[n], valid[v, 1]) - max(left, valid[v, 0])
            if seen > 0 and not values[n] > 0.0:
                energy[v] += seen * values[n] * values[n]
                area -= seen * values[n]
            left = ends[n]
    return area
