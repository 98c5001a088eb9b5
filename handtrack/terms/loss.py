"""Robust losses: value and weight of a squared residual."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from handtrack.arrays import Axes, Floats


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
