"""Robust losses: value and weight of a squared residual."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from handtrack.arrays import Axes, Floats
from handtrack.errors import HandtrackError
from handtrack.terms.loss_kernels import GEMAN_MCCLURE, HUBER, OUTLIERS, QUADRATIC


class Loss(Protocol):
    """ρ(r²) with ρ ≈ r² for small residuals."""

    def value(self, squared: Floats[*Axes]) -> Floats[*Axes]:
        """Return ρ(r²)."""
        ...

    def weight(self, squared: Floats[*Axes]) -> Floats[*Axes]:
        """Return dρ/d(r²), the weight of iteratively reweighted least squares."""
        ...


@dataclass(frozen=True)
class Quadratic:
    """No robustness."""

    def value(self, squared: Floats[*Axes]) -> Floats[*Axes]:
        return squared

    def weight(self, squared: Floats[*Axes]) -> Floats[*Axes]:
        return np.ones_like(squared)


@dataclass(frozen=True)
class GemanMcClure:
    """Saturates at scale²: a residual beyond a few `scale` no longer pulls."""

    scale: float

    def value(self, squared: Floats[*Axes]) -> Floats[*Axes]:
        s2 = self.scale**2
        return squared * s2 / (squared + s2)

    def weight(self, squared: Floats[*Axes]) -> Floats[*Axes]:
        s2 = self.scale**2
        return (s2 / (squared + s2)) ** 2


@dataclass(frozen=True)
class Huber:
    """Quadratic up to `scale`, linear beyond."""

    scale: float

    def value(self, squared: Floats[*Axes]) -> Floats[*Axes]:
        size = np.sqrt(squared)
        return np.where(size <= self.scale, squared, 2 * self.scale * size - self.scale**2)

    def weight(self, squared: Floats[*Axes]) -> Floats[*Axes]:
        return self.scale / np.maximum(np.sqrt(squared), self.scale)


@dataclass(frozen=True)
class UniformOutliers:
    """A residual is normal with probability 1 − share, and otherwise anywhere in ± half_width (in sigmas).

    ρ = −2 log((exp(−r²/2) + c)/(1 + c)), c = share/(1 − share) · √(2π)/(2 half_width).
    """

    share: float = 0.2
    half_width: float = 30.0

    def __post_init__(self) -> None:
        if not (0.0 < self.share < 1.0 and 0.0 < self.half_width < np.inf):
            raise HandtrackError(
                f"outliers: share {self.share:g} and half width {self.half_width:g} sigmas; expected a share between "
                "0 and 1 and a positive width."
            )

    @property
    def level(self) -> float:
        """c, an outlier's density beside an exact point's."""
        return self.share / (1.0 - self.share) * np.sqrt(2.0 * np.pi) / (2.0 * self.half_width)

    def value(self, squared: Floats[*Axes]) -> Floats[*Axes]:
        return -2.0 * np.log((np.exp(-0.5 * squared) + self.level) / (1.0 + self.level))

    def weight(self, squared: Floats[*Axes]) -> Floats[*Axes]:
        inlier = np.exp(-0.5 * squared)
        return inlier / (inlier + self.level)


def compiled_loss(loss: Loss, term: str) -> tuple[int, float]:
    """Return the number and scale by which kernels know a loss."""
    if isinstance(loss, Quadratic):
        return QUADRATIC, 0.0
    if isinstance(loss, GemanMcClure):
        return GEMAN_MCCLURE, float(loss.scale)
    if isinstance(loss, Huber):
        return HUBER, float(loss.scale)
    if isinstance(loss, UniformOutliers):
        return OUTLIERS, float(loss.level)
    raise HandtrackError(
        f"{term}: the loss {type(loss).__name__} is not compiled; known: Quadratic, GemanMcClure, Huber, "
        "UniformOutliers."
    )
