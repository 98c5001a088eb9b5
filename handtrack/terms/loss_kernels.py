"""The losses of terms/loss.py, compiled."""

from __future__ import annotations

import numba
import numpy as np

QUADRATIC, GEMAN_MCCLURE, HUBER, OUTLIERS = range(4)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def counted(loss, scale, squared):  # pragma: no cover - compiled
    """Return ρ(r²) and dρ/d(r²). scale: the loss's; of OUTLIERS, an outlier's density beside an exact point's."""
    if loss == QUADRATIC:
        return squared, 1.0
    if loss == GEMAN_MCCLURE:
        share = scale * scale / (squared + scale * scale)
        return squared * share, share * share
    if loss == HUBER:
        size = np.sqrt(squared)
        if size <= scale:
            return squared, 1.0
        return 2.0 * scale * size - scale * scale, scale / size
    inlier = np.exp(-0.5 * squared)
    return -2.0 * np.log((inlier + scale) / (1.0 + scale)), inlier / (inlier + scale)
