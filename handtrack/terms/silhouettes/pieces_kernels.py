"""Compiled preparation of a mask: where its value changes along a row, and the pieces of one value in between."""

from __future__ import annotations

import numpy as np
from numba.core import types

from handtrack.compiled import compiled
from handtrack.terms.lanes_kernels import BYTE, LONG, written
from handtrack.terms.silhouettes.row_kernels import BLOCK


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
