"""Compiled Cholesky factor, solution and selected inverse of a block-banded matrix.

In a factor's blocks (F, REACH + 1, P, P) those of the diagonal stand inverted.
"""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled


@compiled
def factor(lower):  # pragma: no cover - compiled
    """Turn blocks (F, REACH + 1, P, P) into a factor's in place. Raises LinAlgError where the matrix is not positive definite."""
    frames, reach, _, _ = lower.shape
    for t in range(frames):
        lower[t, 0] = np.linalg.inv(np.linalg.cholesky(lower[t, 0]))
        for k in range(1, min(reach, frames - t)):
            lower[t, k] = lower[t, k] @ lower[t, 0].T
            for j in range(1, k + 1):
                lower[t + j, k - j] -= lower[t, k] @ lower[t, j].T


@compiled
def solve(lower, x):  # pragma: no cover - compiled
    """Turn right sides x (F, P, K) into solutions, in place."""
    frames, reach, _, _ = lower.shape
    for t in range(frames):
        x[t] = lower[t, 0] @ x[t]
        for k in range(1, min(reach, frames - t)):
            x[t + k] -= lower[t, k] @ x[t]
    for t in range(frames - 1, -1, -1):
        for k in range(1, min(reach, frames - t)):
            x[t] -= lower[t, k].T @ x[t + k]
        x[t] = lower[t, 0].T @ x[t]


@compiled
def inverse(lower, found, known):  # pragma: no cover - compiled
    """Write the inverse's blocks (F, REACH + 1, P, P) where the matrix has any; those of the last `known` frames stand already."""
    frames, reach, _, _ = lower.shape
    for t in range(frames - known - 1, -1, -1):
        after = min(reach, frames - t)
        found[t] = 0.0
        for b in range(1, after):  # Σ_below,t = −Σ_below G
            gain = lower[t, b] @ lower[t, 0]
            for a in range(1, after):
                if a < b:
                    found[t, a] -= found[t + a, b - a].T @ gain
                else:
                    found[t, a] -= found[t + b, a - b] @ gain
        own = lower[t, 0].T @ lower[t, 0]
        for k in range(1, after):  # Σ_tt = … + Gᵀ Σ_below G
            own -= (lower[t, k] @ lower[t, 0]).T @ found[t, k]
        found[t, 0] = 0.5 * (own + own.T)  # rounding that is not symmetric would grow
