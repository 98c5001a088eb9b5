"""Common base of ConicFieldTerm and CoverageTerm: a field painted by ellipsoids against a mask."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from handtrack.arrays import D2, D13, B, C, E, Floats, N, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.model.flesh import Ellipsoids
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.observation.observation import Silhouette
from handtrack.terms.bone_system import Sums
from handtrack.terms.silhouettes.prepared_silhouette import PreparedSilhouette, prepare
from handtrack.terms.silhouettes.silhouette_kernels import (
    CameraField,
    silhouette_sums,
)
from handtrack.terms.term import ObservationTerm

MOST_ELLIPSOIDS = 1000


@array_dataclass
class FieldShape:
    """P = min over ellipsoids of s (q − t), at most 0 and at least −limit; q: −1 at the centre, 0 on the outline."""

    levels: Floats[C, E, D2]
    """t and s of each ellipsoid in each camera."""
    limit: float
    """infinite for a field without a floor"""
    depth_scaled: bool = False
    """the paper's scale: s = −1/C*₃₃ [m⁻²] instead, which puts near ellipsoids before far ones"""
    row_steps: tuple[int, ...] = ()
    """of how many rows one is looked at, in each camera; empty: all rows"""

    def of_camera(self, camera: int) -> CameraField:
        """Return the field in one camera, for compiled sums."""
        levels = np.ascontiguousarray(self.levels[camera])
        return CameraField(levels, float(self.limit), self.depth_scaled, self.row_step(camera))

    def row_step(self, camera: int) -> int:
        """Return of how many rows one is looked at in a camera."""
        return self.row_steps[camera] if self.row_steps else 1


def plain_field(cameras: int, ellipsoids: int, depth_scaled: bool = False) -> FieldShape:
    """Return the field of the 2007 paper, eqs. 18–19: negative inside the outlines, no floor."""
    levels = np.zeros((cameras, ellipsoids, 2))
    levels[..., 1] = 1.0
    return FieldShape(levels, np.inf, depth_scaled)


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


class _View(NamedTuple):
    """What does not change from pose to pose in one camera; plain tuples, as `silhouette_sums` takes them."""

    ellipsoids: tuple[Any, ...]
    mask: tuple[Any, ...]
    field: tuple[Any, ...]
    weight: float
    energy: float
    """½ weight ΣZ²"""


class FieldTerm(ObservationTerm):
    """½ weight Σ (P − Z)² over all observed pixels; what P is, a subclass says by its `shape`."""

    shape: FieldShape

    def __init__(
        self,
        silhouettes: Sequence[Silhouette | PreparedSilhouette],
        ellipsoids: Ellipsoids,
        weight: float | Sequence[float],
        name: str,
    ) -> None:
        self.name = name
        self.weight = weight
        self.ellipsoids = ellipsoids
        self.silhouettes = prepared(silhouettes)
        if len(ellipsoids) > MOST_ELLIPSOIDS:
            raise HandtrackError(
                f"silhouettes: {len(ellipsoids)} ellipsoids; at most {MOST_ELLIPSOIDS} are handled. Use a coarser model."
            )

    def alone(self) -> list[Self]:
        """Return one term for each camera; together they are this one."""
        weights, shape = per_camera(self.weight, len(self.silhouettes), "weight"), self.shape
        return [
            self._with(
                silhouettes=(seen,),
                weight=weights[i],
                shape=replace(
                    shape, levels=shape.levels[i : i + 1], row_steps=shape.row_steps[i : i + 1]
                ),
            )
            for i, seen in enumerate(self.silhouettes)
        ]

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
        outline = np.broadcast_to(fields.outline, (len(fields.flesh), 1, len(fields.outline)))
        return np.concatenate([fields.flesh, outline], axis=1)

    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        cost, frames, gathered = 0.0, tuple(bones.frames), tuple(sums)
        rescaled = self.ellipsoids.rescaled(bones)
        radii = rescaled.arrays.radii
        for view, seen in zip(self._views, self.silhouettes, strict=True):
            is_larger = rescaled is not self.ellipsoids
            flesh = tuple(rescaled.thicker(seen.wider_m).arrays) if is_larger else view.ellipsoids
            part = silhouette_sums(
                frames, flesh, radii, view.mask, view.field, view.weight, gathered
            )
            cost += max(part + view.energy, 0.0)
        return cost

    @cached_property
    def _views(self) -> list[_View]:
        weights, views = per_camera(self.weight, len(self.silhouettes), "weight"), []
        for i, seen in enumerate(self.silhouettes):
            field, flesh = self.shape.of_camera(i), self.ellipsoids.thicker(seen.wider_m).arrays
            energy = 0.5 * weights[i] * seen.energy(field.step)
            arrays = tuple(flesh), tuple(seen.arrays), tuple(field)
            views.append(_View(*arrays, weights[i], energy))
        return views
