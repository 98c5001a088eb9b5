"""Robust losses ρ(r²), with ρ ≈ r² for small residuals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handtrack.arrays import Axes, Floats
from handtrack.compiled import compiled_as_numpy
from handtrack.errors import HandtrackError

_QUADRATIC, _GEMAN_MCCLURE, _HUBER, _OUTLIERS = range(4)


class Loss(NamedTuple):
    """A loss, as compiled code takes it; made by `quadratic`, `geman_mcclure`, `huber` or `uniform_outliers`."""

    kind: int
    scale: float

    @property
    def has_bound(self) -> bool:
        """Whether no residual costs more than scale²."""
        return self.kind == _GEMAN_MCCLURE

    def value(self, squared: Floats[*Axes]) -> Floats[*Axes]:
        """Return ρ(r²)."""
        return self._each(squared, 0)

    def weight(self, squared: Floats[*Axes]) -> Floats[*Axes]:
        """Return dρ/d(r²), the weight of iteratively reweighted least squares."""
        return self._each(squared, 1)

    def _each(self, squared: Floats, which: int) -> Floats:
        flat = np.ascontiguousarray(squared, dtype=float)
        return _all_robust(self, flat.reshape(-1))[which].reshape(flat.shape)


def quadratic() -> Loss:
    """Return the loss without robustness."""
    return Loss(_QUADRATIC, 0.0)


def geman_mcclure(scale: float) -> Loss:
    """Return the loss r² s²/(r² + s²), which saturates at s²: a residual beyond a few `scale` no longer pulls."""
    return Loss(_GEMAN_MCCLURE, float(scale))


def huber(scale: float) -> Loss:
    """Return the loss that is quadratic up to `scale`, and linear beyond."""
    return Loss(_HUBER, float(scale))


def uniform_outliers(share: float = 0.2, half_width: float = 30.0) -> Loss:
    """Return the loss of a residual that is normal with probability 1 − share, and otherwise anywhere in ± half_width (in sigmas).

    ρ = −2 log((exp(−r²/2) + c)/(1 + c)), with c = share/(1 − share) · √(2π)/(2 half_width), an outlier's density beside an exact
    point's, for the scale.
    """
    if not (0.0 < share < 1.0 and 0.0 < half_width < np.inf):
        raise HandtrackError(
            f"outliers: share {share:g} and half width {half_width:g} sigmas; expected a share between "
            "0 and 1 and a positive width."
        )
    return Loss(_OUTLIERS, float(share / (1.0 - share) * np.sqrt(2.0 * np.pi) / (2.0 * half_width)))


@compiled_as_numpy
def robust(loss, squared):  # pragma: no cover - compiled
    """Return ρ(r²) and dρ/d(r²)."""
    scale = loss.scale
    if loss.kind == _QUADRATIC:
        return squared, 1.0
    if loss.kind == _GEMAN_MCCLURE:
        share = scale * scale / (squared + scale * scale)
        return squared * share, share * share
    if loss.kind == _HUBER:
        size = np.sqrt(squared)
        if size <= scale:
            return squared, 1.0
        return 2.0 * scale * size - scale * scale, scale / size
    inlier = np.exp(-0.5 * squared)
    return -2.0 * np.log((inlier + scale) / (1.0 + scale)), inlier / (inlier + scale)


@compiled_as_numpy
def robust_slope(loss, squared):  # pragma: no cover - compiled
    """Return d²ρ/d(r²)²."""
    scale = loss.scale
    if loss.kind == _GEMAN_MCCLURE:
        share = scale * scale / (squared + scale * scale)
        return -2.0 * share * share / (squared + scale * scale)
    if loss.kind == _HUBER and squared > scale * scale:
        return -0.5 * scale / (np.sqrt(squared) * squared)
    if loss.kind == _OUTLIERS:
        inlier = np.exp(-0.5 * squared)
        return -0.5 * inlier * scale / (inlier + scale) ** 2
    return 0.0


@compiled_as_numpy
def _all_robust(loss, squared):  # pragma: no cover - compiled
    value, weight = np.empty(squared.shape), np.empty(squared.shape)
    for n in range(squared.shape[0]):
        value[n], weight[n] = robust(loss, squared[n])
    return value, weight
