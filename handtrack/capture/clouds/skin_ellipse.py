"""SkinEllipse: skin colour as an ellipse in (r, g) chromaticity, fitted from samples.

r = R / (R + G + B), g = G / (R + G + B): brightness drops out. After the point cloud paper, §2.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta

from handtrack.arrays import D2, D3, Array, Floats, N
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import above

_LEAST_SAMPLES = 20
_ROUNDING = 0.004**2 * np.eye(2)  # 8 bit levels are about 0.004 apart in (r, g)
_DARK = 24  # R + G + B below that has no colour to speak of
_TRIMS = 3
_TRIM_SIZE = 3.0
_MAD_TO_SIGMA = 1.4826


def _fitted(count: int) -> Meta:
    return Meta(description=f"{count} numbers, as fitted from samples of skin")


@dataclass(frozen=True)
class SkinEllipse:
    """Colours within `size` standard deviations of the mean skin colour."""

    mean: Annotated[tuple[float, float], _fitted(2)]
    """r, g of the ellipse's centre."""
    covariance: Annotated[tuple[float, float, float], _fitted(3)]
    """of rr, rg, gg: ratio and orientation of its axes."""
    size: Annotated[float, above(0, "standard deviations")] = 2.5
    """the threshold: half axes in standard deviations."""

    def __post_init__(self) -> None:
        rr, rg, gg = self.covariance
        if not (rr > 0 and rr * gg > rg**2):
            raise ValueError(
                f"covariance = {list(self.covariance)}; expected rr, rg, gg of an ellipse: rr gg > rg²."
            )

    def distance(self, colors: Array[N, D3]) -> Floats[N]:
        """Return how far colours uint8 RGB lie from the mean, standard deviations.

        Infinite for colours too dark to have one.
        """
        rg, bright = chromaticity(colors)
        rr, cross, gg = self.covariance
        inverse = np.linalg.inv(np.array([[rr, cross], [cross, gg]]))
        r, g = (rg - np.array(self.mean, np.float32)).T
        squared = inverse[0, 0] * r * r + 2.0 * inverse[0, 1] * r * g + inverse[1, 1] * g * g
        return np.where(bright, np.sqrt(squared), np.inf)


def chromaticity(colors: Array[N, D3]) -> tuple[Floats[N, D2], Array[N]]:
    """Return (r, g) of colours uint8 RGB, and whether each is bright enough."""
    values = np.asarray(colors, np.float32)  # of a whole image: memory is what takes time
    total = values.sum(axis=-1)
    return values[:, :2] / np.maximum(total, 1.0)[:, None], total >= _DARK


def fit_skin_ellipse(*images: Array[N, D3], size: float = 2.5) -> SkinEllipse:
    """Return the one ellipse of skin samples uint8 RGB of one or more images: painted, boxed, or inside masks.

    Samples far off (a nail's rim, background caught in the box) are trimmed, in each image by itself: another one's light is no
    outlier. Each image counts as much as another, however large its patch. Raises HandtrackError with fewer than 20 samples in
    all that are bright enough.
    """
    known = []
    for samples in images:
        rg, bright = chromaticity(np.asarray(samples).reshape(-1, 3))
        known.append(rg[bright])
    count = sum(map(len, known))
    if count < _LEAST_SAMPLES:
        raise HandtrackError(
            f"the skin's colour needs at least {_LEAST_SAMPLES} sampled pixels that are not black; "
            f"found {count}. Mark a larger patch of skin."
        )
    parts = [_trimmed(rg) for rg in known if len(rg)]
    kept = np.concatenate(parts)
    share = np.concatenate([np.full(len(rg), 1.0 / len(rg)) for rg in parts])
    mean = np.average(kept, axis=0, weights=share)
    covariance = np.cov(kept.T, aweights=share) + _ROUNDING
    return SkinEllipse(
        (float(mean[0]), float(mean[1])),
        (float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])),
        size,
    )


def _trimmed(rg: Floats[N, D2]) -> Floats[N, D2]:
    """Return the samples of one image without those far off; a few, which have no spread to speak of, as they are."""
    if len(rg) < _LEAST_SAMPLES:
        return rg
    mean = np.median(rg, axis=0)
    spread = _MAD_TO_SIGMA * np.median(np.abs(rg - mean), axis=0)
    covariance = np.diag(spread**2) + _ROUNDING
    for _ in range(_TRIMS):
        off = rg - mean
        near = np.einsum("ni,ij,nj->n", off, np.linalg.inv(covariance), off) <= _TRIM_SIZE**2
        mean = rg[near].mean(axis=0)
        covariance = np.cov(rg[near].T) + _ROUNDING
    return rg[near]
