"""Losses of cloud terms: which are compiled, and the outlier class."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Axes, Floats
from handtrack.errors import HandtrackError
from handtrack.terms.clouds.cloud_loss_kernels import GEMAN_MCCLURE, HUBER, OUTLIERS, QUADRATIC
from handtrack.terms.loss import GemanMcClure, Huber, Loss, Quadratic


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
