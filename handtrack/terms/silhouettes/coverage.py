"""Silhouettes as coverage: 0 outside, −1 inside, and a ramp in a band around each outline. The default."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import C, E, Floats
from handtrack.geometry.camera import Camera
from handtrack.model.flesh import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Silhouette
from handtrack.terms.silhouettes.prepared_silhouette import PreparedSilhouette
from handtrack.terms.silhouettes.silhouette_field import FieldShape, FieldTerm, per_camera

_NARROWEST, _WIDEST = 1e-6, 100.0  # of a band, in minor radii
_ROWS_A_BAND = 0.5  # rows nearer to each other tell the same; every 4th row in wide bands moved a recording seen by < 0.01 mm


def rows_apart(band_px: float | Sequence[float]) -> tuple[int, ...]:
    """Return, for bands that wide [px], of how many rows one is enough."""
    return tuple(max(int(_ROWS_A_BAND * px), 1) for px in np.atleast_1d(band_px))


class CoverageTerm(FieldTerm):
    """½ weight Σ (P − Z)² over all observed pixels, P = clip((q − t_o)/(t_i + t_o), −1, 0), Z = −mask.

    The band reaches ± band_px around the outline (at the minor axis' ends), so mask that the model misses pulls it.
    antisymmetric: t_o = t_i, the unbiased form for the last iterations and for estimating size; otherwise the wide
    form. row_steps: of how many rows one is looked at, in each camera. The band's width in field units is fixed by the depths at `bones_at_start`, so that cost and gradient agree.
    """

    def __init__(
        self,
        silhouettes: Sequence[Silhouette | PreparedSilhouette],
        ellipsoids: Ellipsoids,
        band_px: float | Sequence[float],
        bones_at_start: BonePoses,
        antisymmetric: bool = False,
        weight: float | Sequence[float] = 1.0,
        row_steps: tuple[int, ...] = (),
    ) -> None:
        super().__init__(silhouettes, ellipsoids, weight, "coverage")
        cameras = [s.camera for s in self.silhouettes]
        shape = ramp(cameras, ellipsoids, band_px, bones_at_start, antisymmetric)
        self.shape = replace(shape, row_steps=row_steps)
        self.band_px = per_camera(band_px, len(cameras), "the band's width")

    def outline_errors_px(self, bones: BonePoses) -> Floats[C]:
        """Return how far the model's outline is from each mask's, one distance along all of it, antisymmetric form; NaN for no outline.

        Along an outline that is off by d, ½ (P − Z)² sums to b/12 + d²/4b for each pixel of it, and to d/2 − b/6 beyond the band's
        half-width b (docs/explanation/silhouettes.md).
        """
        found = []
        for term, band, seen in zip(self.alone(), self.band_px, self.silhouettes, strict=True):
            weight, length = float(np.ravel(term.weight)[0]), seen.outline_px
            cost = term.cost(bones) / (weight * length) if weight * length > 0 else np.nan
            near = np.sqrt(4.0 * band * max(cost - band / 12.0, 0.0))
            found.append(near if cost <= band / 3.0 else 2.0 * cost + band / 3.0)
        return np.array(found)


def ramp(
    cameras: Sequence[Camera],
    ellipsoids: Ellipsoids,
    band_px: float | Sequence[float],
    bones: BonePoses,
    antisymmetric: bool,
) -> FieldShape:
    """Return the ramp whose band is ± band_px wide at the depths of `bones`; mathematics: docs/derivations."""
    centre = ellipsoids.posed(bones).centre
    least = ellipsoids.radii.min(axis=1)
    levels = np.empty((len(cameras), len(ellipsoids), 2))
    bands = per_camera(band_px, len(cameras), "the band's width")
    for i, camera in enumerate(cameras):
        focal = camera.focal_px
        depth = np.maximum(camera.to_camera(centre)[:, 2], least)
        share = np.clip(bands[i] * depth / np.maximum(least * focal, 1e-12), _NARROWEST, _WIDEST)
        outer, inner = ramp_levels(share, antisymmetric)
        levels[i, :, 0] = outer
        levels[i, :, 1] = 1.0 / (inner + outer)
    return FieldShape(levels, 1.0)


def ramp_levels(share: Floats[E], antisymmetric: bool) -> tuple[Floats[E], Floats[E]]:
    """Return t_o and t_i of a band of ± share · (minor radius)."""
    if antisymmetric:
        both = np.minimum(2.0 * share, 1.0)
        return both, both
    return (1.0 + share) ** 2 - 1.0, 1.0 - np.maximum(0.0, 1.0 - share) ** 2
