"""Silhouettes: a field painted by ellipsoids against a mask; conic (the 2007 paper's), or coverage, the default."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from handtrack.arrays import D3, D13, B, C, E, Floats, N
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.observation.observation import Silhouette
from handtrack.terms.bone_system import Sums
from handtrack.terms.silhouettes.prepared_silhouette import PreparedSilhouette, prepare
from handtrack.terms.silhouettes.silhouette_kernels import CameraField, silhouette_sums
from handtrack.terms.term import ObservationTerm

MOST_ELLIPSOIDS = 1000
_NARROWEST, _WIDEST = 1e-6, 100.0  # of a band, in minor radii
_ROWS_A_BAND = 0.5  # rows nearer to each other tell the same; every 4th row in wide bands moved a recording seen by < 0.01 mm


def prepared(
    silhouettes: Sequence[Silhouette | PreparedSilhouette],
) -> tuple[PreparedSilhouette, ...]:
    """Return the silhouettes, prepared where they are not yet."""
    return tuple(s if isinstance(s, PreparedSilhouette) else prepare(s) for s in silhouettes)


def per_camera(value: float | Sequence[float], cameras: int, name: str) -> tuple[float, ...]:
    """Return one number a camera."""
    if isinstance(value, float | int):
        return (float(value),) * cameras
    if len(value) != cameras:
        raise HandtrackError(
            f"silhouettes: {len(value)} numbers for {name}; expected one, or {cameras} (one a camera)."
        )
    return tuple(float(x) for x in value)


class FieldTerm(ObservationTerm):
    """½ weight Σ (P − Z)² over all observed pixels; what P is, a subclass says by its `fields`, one a camera."""

    fields: tuple[CameraField, ...]

    def __init__(
        self,
        silhouettes: Sequence[Silhouette | PreparedSilhouette],
        ellipsoids: Ellipsoids,
        weight: float | Sequence[float],
        name: str,
    ) -> None:
        self.name = name
        self.ellipsoids = ellipsoids
        self.silhouettes = prepared(silhouettes)
        self.weights = per_camera(weight, len(self.silhouettes), "weight")
        if len(ellipsoids) > MOST_ELLIPSOIDS:
            raise HandtrackError(
                f"silhouettes: {len(ellipsoids)} ellipsoids; at most {MOST_ELLIPSOIDS} are handled. Use a coarser model."
            )

    def alone(self) -> list[Self]:
        """Return one term for each camera; together they are this one."""
        own = zip(self.silhouettes, self.weights, self.fields, strict=True)
        return [self._with(silhouettes=(s,), weights=(w,), fields=(f,)) for s, w, f in own]

    def wider(self, by_m: float) -> Self:
        """Return the term of masks in which the outline of a hand is so much farther out than the hand's own."""
        return self._with(silhouettes=tuple(replace(s, wider_m=by_m) for s in self.silhouettes))

    def _with(self, **changes: object) -> Self:
        term = copy(self)
        vars(term).pop("_views", None)
        vars(term).update(changes)
        return term

    def motion(self, bones: BonePoses, fields: BoneFields) -> Floats[B, D13, N]:
        """Return how the ellipsoids move and deform, and by how much their outlines are farther out."""
        outline = np.broadcast_to(fields.outline, (len(fields.surface), 1, len(fields.outline)))
        return np.concatenate([fields.surface, outline], axis=1)

    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        cost, frames, gathered = 0.0, tuple(bones.frames), tuple(sums)
        rescaled = self.ellipsoids.rescaled(bones)
        *_, radii = rescaled.arrays
        for (ellipsoids, *view, energy), seen in zip(self._views, self.silhouettes, strict=True):
            if rescaled is not self.ellipsoids:
                ellipsoids = rescaled.thicker(seen.wider_m).arrays
            cost += max(silhouette_sums(frames, ellipsoids, radii, *view, gathered) + energy, 0.0)
        return cost

    @cached_property
    def _views(self) -> list[tuple[Any, ...]]:
        """What does not change from pose to pose in each camera: ellipsoids, mask, field and weight, plain tuples as `silhouette_sums`
        takes them, and ½ weight ΣZ².
        """
        views = []
        for seen, weight, field in zip(self.silhouettes, self.weights, self.fields, strict=True):
            ellipsoids = self.ellipsoids.thicker(seen.wider_m).arrays
            energy = 0.5 * weight * seen.energy(field.step)
            views.append((ellipsoids, tuple(seen.mask), tuple(field), weight, energy))
        return views


class ConicFieldTerm(FieldTerm):
    """½ weight Σ (P − Z)² over all observed pixels; P the lowest conic field, negative inside the outlines and without a floor (eqs. 18–29),
    by moments instead of a Jacobian of pixels; Z = −mask or a given field image.

    It has no gradient where the hand is seen beside the model, and on masks its minimum is biased: CoverageTerm is
    the default. normalised: fields are −1 at their centres; otherwise 1/C*₃₃ [m⁻²], the paper's scale, in which near
    ellipsoids hide far ones. That scale needs an observed field in the same scale: `prepare(s, observation=...)`.
    """

    def __init__(
        self,
        silhouettes: Sequence[Silhouette | PreparedSilhouette],
        ellipsoids: Ellipsoids,
        weight: float | Sequence[float] = 1.0,
        normalised: bool = True,
    ) -> None:
        super().__init__(silhouettes, ellipsoids, weight, "conic_field")
        levels = np.tile([0.0, 1.0], (len(ellipsoids), 1))
        self.fields = tuple(
            CameraField(s.camera.projection, levels, np.inf, not normalised, 1)
            for s in self.silhouettes
        )


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
        count = len(self.silhouettes)
        self.band_px = per_camera(band_px, count, "the band's width")
        self.fields = _ramps(
            [seen.camera for seen in self.silhouettes],
            ellipsoids.radii.min(axis=1),
            ellipsoids.centres(bones_at_start),
            self.band_px,
            antisymmetric,
            row_steps or (1,) * count,
        )

    def outline_errors_px(self, bones: Sequence[BonePoses]) -> Floats[C]:
        """Return how far the model's outline is from each mask's, bones being where that camera saw them, one distance along all of
        it, antisymmetric form; NaN for no outline.

        Along an outline that is off by d, ½ (P − Z)² sums to b/12 + d²/4b for each pixel of it, and to d/2 − b/6 beyond the band's
        half-width b (docs/explanation/silhouettes.md).
        """
        found = []
        cameras = zip(self.alone(), self.band_px, self.silhouettes, bones, strict=True)
        for term, band, seen, there in cameras:
            weight, length = term.weights[0], seen.outline_px
            cost = term.cost(there) / (weight * length) if weight * length > 0 else np.nan
            near = np.sqrt(4.0 * band * max(cost - band / 12.0, 0.0))
            found.append(near if cost <= band / 3.0 else 2.0 * cost + band / 3.0)
        return np.array(found)


def _ramps(
    cameras: Sequence[Camera],
    least: Floats[E],
    centre: Floats[E, D3],
    band_px: Sequence[float],
    antisymmetric: bool,
    row_steps: Sequence[int],
) -> tuple[CameraField, ...]:
    """Return each camera's ramp, whose band is ± band_px wide at the depths of ellipsoids; mathematics: docs/derivations.

    least, centre: minor radii [m], and where they are, world [m].
    """
    focal = np.array([[camera.focal_px] for camera in cameras])
    depth = np.maximum([camera.to_camera(centre)[:, 2] for camera in cameras], least)
    share = np.array(band_px)[:, None] * depth / np.maximum(least * focal, 1e-12)
    share = np.minimum(np.maximum(share, _NARROWEST), _WIDEST)
    outer, inner = ramp_levels(share, antisymmetric)
    levels = np.stack([outer, 1.0 / (inner + outer)], axis=-1)
    views = zip(cameras, levels, row_steps, strict=True)
    return tuple(CameraField(c.projection, own, 1.0, False, step) for c, own, step in views)


def ramp_levels(share: Floats[E], antisymmetric: bool) -> tuple[Floats[E], Floats[E]]:
    """Return t_o and t_i of a band of ± share · (minor radius)."""
    if antisymmetric:
        both = np.minimum(2.0 * share, 1.0)
        return both, both
    return (1.0 + share) ** 2 - 1.0, 1.0 - np.maximum(0.0, 1.0 - share) ** 2
