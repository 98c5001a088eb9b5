"""Compiled: a residual's row by a bone's twist or field, and the pull-back of bone systems to joint parameters."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def pull_back_blocks(gradient, hessian, jacobian, is_block):  # pragma: no cover - compiled
    """Return Jᵀ g (S,) and Jᵀ H J (S, S) for J (B, 6, S); blocks of H that are zero cost nothing, and threads of BLAS would cost more.

    is_block: only the 6 × 6 blocks of bones with themselves are looked at.
    """
    bones, _, count = jacobian.shape
    g, h = np.zeros(count), np.zeros((count, count))
    product = np.empty((6, count))
    for b in range(bones):
        product[:] = 0.0
        seen = False
        for c in range(b if is_block else 0, b + 1 if is_block else bones):
            used = False
            for i in range(6):
                for j in range(6):
                    if hessian[6 * b + i, 6 * c + j] != 0.0:
                        used = True
            if not used:
                continue
            seen = True
            for i in range(6):
                for j in range(6):
                    x = hessian[6 * b + i, 6 * c + j]
                    if x != 0.0:
                        for s in range(count):
                            product[i, s] += x * jacobian[c, j, s]
        for i in range(6):
            x = gradient[6 * b + i]
            if x != 0.0:
                for s in range(count):
                    g[s] += jacobian[b, i, s] * x
        if not seen:
            continue
        for i in range(6):
            for s in range(count):
                x = jacobian[b, i, s]
                if x != 0.0:
                    for t in range(count):
                        h[s, t] += x * product[i, t]
    for s in range(count):
        for t in range(s):
            middle = 0.5 * (h[s, t] + h[t, s])
            h[s, t] = middle
            h[t, s] = middle
    return g, h


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def fill_arm(row, at, width, x, y, z):  # pragma: no cover - compiled
    """Complete row[at : at + width], whose first three are n, for a point at (x, y, z) = X − o: [n ; (X − o) × n] by a twist,
    [n ; n (X − o)ᵀ] by a field of twelve numbers.
    """
    n0, n1, n2 = row[at], row[at + 1], row[at + 2]
    if width == 12:
        row[at + 3], row[at + 4], row[at + 5] = n0 * x, n0 * y, n0 * z
        row[at + 6], row[at + 7], row[at + 8] = n1 * x, n1 * y, n1 * z
        row[at + 9], row[at + 10], row[at + 11] = n2 * x, n2 * y, n2 * z
    else:
        row[at + 3] = y * n2 - z * n1
        row[at + 4] = z * n0 - x * n2
        row[at + 5] = x * n1 - y * n0


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def add_outer(row, at, factor, a, b):  # pragma: no cover - compiled
    """Add factor · a bᵀ to the nine of G in row[at : at + 12]."""
    for i in range(3):
        for j in range(3):
            row[at + 3 + 3 * i + j] += factor * a[i] * b[j]
