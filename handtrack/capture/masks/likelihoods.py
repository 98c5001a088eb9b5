"""How often hand and background have a colour, learned from pixels of one recording."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Axes, Floats, H, N, W

_BITS = 4
"""of each channel: 16 levels, as coarse as skin is even"""
_LEVELS = 1 << _BITS
_BINS = _LEVELS**3
_STRANGE = 0.02
"""share of pixels that are of none of the colours seen: reflections, compression; bounds what one pixel can say"""
_SPREAD = (0.25, 0.5, 0.25)
"""colours one level apart are half as likely the same (a light that turns does that much)"""


@dataclass(eq=False)
class Colours:
    """Counts of three channels of 8 bits."""

    counts: Floats[N] = field(default_factory=lambda: np.zeros(_BINS))

    def add(self, bins: Array[*Axes], weights: Array[*Axes] | None = None) -> None:
        """Add pixels by their bins, see `bins_of`; weights: how much each counts."""
        self.counts += np.bincount(
            bins.ravel(), None if weights is None else weights.ravel(), _BINS
        )

    def log_likelihood(self) -> Floats[N]:
        """Return log p of each bin; of all alike where nothing was counted."""
        cube = self.counts.reshape((_LEVELS,) * 3)
        for axis in range(3):
            cube = _widened(cube, axis)
        total = float(cube.sum())
        share = cube.ravel() / total if total > 0 else np.full(_BINS, 1.0 / _BINS)
        return np.log((1 - _STRANGE) * share + _STRANGE / _BINS)


def mixed(*parts: Floats[N]) -> Floats[N]:
    """Return the log likelihood of a mixture of equal parts."""
    return np.logaddexp.reduce(parts, axis=0) - np.log(len(parts))


def bins_of(channels: Array[H, W, D3]) -> Array[H, W]:
    """Return the bin of each pixel."""
    reduced = channels.astype(np.int32) >> (8 - _BITS)
    return (reduced[..., 0] << (2 * _BITS)) | (reduced[..., 1] << _BITS) | reduced[..., 2]


def smoothed(values: Floats[H, W], guide: Floats[H, W], radius: int) -> Floats[H, W]:
    """Return values averaged over squares of 2 radius + 1, but not across edges of the guide (He, Sun & Tang 2010).

    guide: in units of the noise that is no edge.
    """
    side = (2 * radius + 1,) * 2

    def mean(image: Array) -> Array:
        return cv2.blur(image, side, borderType=cv2.BORDER_REFLECT)

    mean_g, mean_v = mean(guide), mean(values)
    slope = (mean(guide * values) - mean_g * mean_v) / (mean(guide * guide) - mean_g**2 + 1.0)
    return mean(slope) * guide + mean(mean_v - slope * mean_g)


def _widened(cube: Array, axis: int) -> Array:
    moved = np.moveaxis(cube, axis, 0)
    padded = np.concatenate([moved[:1], moved, moved[-1:]])
    low, middle, high = _SPREAD
    return np.moveaxis(low * padded[:-2] + middle * padded[1:-1] + high * padded[2:], 0, axis)
