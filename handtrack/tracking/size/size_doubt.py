"""How well a fitted size is known: of the whole hand, of its parts, and of its length in millimetres."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import Array, Floats, K, N
from handtrack.model.size import SizeParameters, hand_length_mm

_STEP = 1e-3  # of a deviation: the length is as good as linear in it


def doubt_of_size(
    size: SizeParameters, deviations: Floats[N], free: Array[N], covariance: Floats[K, K]
) -> dict[str, float]:
    """Return standard deviations: of `length_mm`, and of the logarithms of `overall` and each part.

    covariance: of the free deviations. What was not fitted is as uncertain as it came, or as adults differ; empty where nothing
    of the size was fitted.
    """
    count = len(size.names) - size.offset_count
    if not free[:count].any():
        return dict(size.model.scale.std)
    names, units, came = size.names[:count], size.units[:count], size.model.scale.std
    std = [came[n] / u if n in came else 1.0 for n, u in zip(names, units, strict=True)]
    whole = np.diag(np.square(std))
    fitted = np.flatnonzero(free[:count])
    whole[np.ix_(fitted, fitted)] = covariance[: len(fitted), : len(fitted)]
    known = dict(zip(names, (np.sqrt(np.diag(whole)) * units).tolist(), strict=True))
    slope = np.zeros(count)
    for k in range(count):
        step = np.zeros(len(deviations))
        step[k] = _STEP
        ahead, behind = (hand_length_mm(size.grown(deviations + s)) for s in (step, -step))
        slope[k] = (ahead - behind) / (2 * _STEP)
    length = float(np.sqrt(slope @ whole @ slope))
    return known if np.isnan(length) else {"length_mm": length} | known
