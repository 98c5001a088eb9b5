"""Compiled Cholesky factor, solution and selected inverse of a block-banded matrix.

Blocks are small: a BLAS that shares each of them out among threads takes a hundred times as long where other programs run.
"""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy


@compiled_as_numpy
def _take(out, one, other, transposed):  # pragma: no cover - compiled
    """out −= one otherᵀ; transposed: work space (P, P)."""
    size = out.shape[0]
    for i in range(size):
        for k in range(size):
            transposed[k, i] = other[i, k]
    for i in range(size):
        for k in range(size):
            share = one[i, k]
            for j in range(size):
                out[i, j] -= share * transposed[k, j]


@compiled_as_numpy
def factor(lower, least):  # pragma: no cover - compiled
    """Turn blocks (F, REACH + 1, P, P) into those of L in place; return False where a pivot is not above `least`."""
    frames, reach, size, _ = lower.shape
    work = np.empty((size, size))
    for t in range(frames):
        for k in range(min(reach, frames - t)):
            for before in range(1, reach - k):
                s = t - before
                if s >= 0:
                    _take(lower[t, k], lower[s, before + k], lower[s, before], work)
        own = lower[t, 0]
        for i in range(size):
            for j in range(i + 1):
                total = own[i, j]
                for k in range(j):
                    total -= own[i, k] * own[j, k]
                if i > j:
                    own[i, j] = total / own[j, j]
                elif total > least:
                    own[i, i] = np.sqrt(total)
                else:
                    return False
            for j in range(i + 1, size):
                own[i, j] = 0.0
        for k in range(1, min(reach, frames - t)):
            block = lower[t, k]
            for i in range(size):
                for j in range(size):
                    total = block[i, j]
                    for m in range(j):
                        total -= block[i, m] * own[j, m]
                    block[i, j] = total / own[j, j]
        for k in range(frames - t, reach):
            lower[t, k] = 0.0
    return True


@compiled_as_numpy
def solve(lower, x):  # pragma: no cover - compiled
    """Turn right sides x (F, P, K) into solutions, in place."""
    frames, reach, size, _ = lower.shape
    count = x.shape[2]
    for t in range(frames):
        for i in range(size):
            for before in range(1, min(reach, t + 1)):
                for m in range(size):
                    share = lower[t - before, before, i, m]
                    for c in range(count):
                        x[t, i, c] -= share * x[t - before, m, c]
            for m in range(i):
                share = lower[t, 0, i, m]
                for c in range(count):
                    x[t, i, c] -= share * x[t, m, c]
            for c in range(count):
                x[t, i, c] /= lower[t, 0, i, i]
    for t in range(frames - 1, -1, -1):
        for ahead in range(1, min(reach, frames - t)):
            for m in range(size):
                for i in range(size):
                    share = lower[t, ahead, m, i]
                    for c in range(count):
                        x[t, i, c] -= share * x[t + ahead, m, c]
        for i in range(size - 1, -1, -1):
            for m in range(i + 1, size):
                share = lower[t, 0, m, i]
                for c in range(count):
                    x[t, i, c] -= share * x[t, m, c]
            for c in range(count):
                x[t, i, c] /= lower[t, 0, i, i]


@compiled_as_numpy
def inverse(lower, found, known):  # pragma: no cover - compiled
    """Write the inverse's blocks (F, REACH + 1, P, P) where the matrix has any; those of the last `known` frames stand already."""
    frames, reach, size, _ = lower.shape
    own, gain = np.empty((size, size)), np.empty((reach, size, size))
    work = np.empty((size, size))
    for t in range(frames - known - 1, -1, -1):
        after = min(reach, frames - t)
        for c in range(size):  # L_tt⁻¹, lower
            for i in range(size):
                own[i, c] = 0.0
            own[c, c] = 1.0 / lower[t, 0, c, c]
            for i in range(c + 1, size):
                total = 0.0
                for m in range(c, i):
                    total -= lower[t, 0, i, m] * own[m, c]
                own[i, c] = total / lower[t, 0, i, i]
        for i in range(size):
            for j in range(size):
                total = 0.0
                for m in range(max(i, j), size):
                    total += own[m, i] * own[m, j]
                found[t, 0, i, j] = total
        for k in range(1, after):  # G = L_below L_tt⁻¹
            for i in range(size):
                for j in range(size):
                    gain[k, i, j] = 0.0
                for m in range(size):
                    share = lower[t, k, i, m]
                    for j in range(m + 1):
                        gain[k, i, j] += share * own[m, j]
        for a in range(1, after):  # Σ_below,t = −Σ_below G
            block = found[t, a]
            block[:] = 0.0
            for b in range(1, after):
                for i in range(size):
                    for m in range(size):
                        if a >= b:
                            share = found[t + b, a - b, i, m]
                        else:
                            share = found[t + a, b - a, m, i]
                        for j in range(size):
                            block[i, j] -= share * gain[b, m, j]
        for k in range(1, after):  # Σ_tt = … + Gᵀ Σ_below G
            for m in range(size):
                for i in range(size):
                    share = gain[k, m, i]
                    for j in range(size):
                        found[t, 0, i, j] -= share * found[t, k, m, j]
        for i in range(size):  # rounding that is not symmetric would grow
            for j in range(size):
                work[i, j] = 0.5 * (found[t, 0, i, j] + found[t, 0, j, i])
        found[t, 0, :, :] = work
        for k in range(after, reach):
            found[t, k] = 0.0
