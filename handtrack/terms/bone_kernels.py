"""Compiled pull-back of bone systems to joint parameters: at this size, threads of BLAS cost more than they bring."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def pull_back_blocks(gradient, hessian, jacobian, is_block):  # pragma: no cover - compiled
    """Return Jᵀ g (S,) and Jᵀ H J (S, S) for J (B, 6, S); blocks of H that are zero cost nothing.

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
