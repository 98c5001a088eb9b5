"""Common base of ConicFieldTerm and CoverageTerm: a field painted by ellipsoids against a mask."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from handtrack.arrays import D2, D3, D4, D6, D9, C, E, Floats, N
from handtrack.errors import HandtrackError
from handtrack.model.flesh import EllipsoidArrays, Ellipsoids
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.observation.observation import Silhouette
from handtrack.terms.bone_system import JointSystem, Sums
from handtrack.terms.ellipsoid_kernels import posed_shapes
from handtrack.terms.silhouettes.conic_kernels import ELLIPSE
from handtrack.terms.silhouettes.prepared_silhouette import PreparedSilhouette, prepare
from handtrack.terms.silhouettes.row_kernels import MOMENTS
from handtrack.terms.silhouettes.silhouette_kernels import (
    CameraField,
    camera_moments,
    silhouette_sums,
    unpack_all,
)
from handtrack.terms.term import ObservationTerm

MOST_ELLIPSOIDS = 1000


@dataclass(frozen=True, eq=False)
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
    """What does not change from pose to pose in one camera."""

    ellipsoids: EllipsoidArrays
    field: CameraField
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
                silhouettes=(seen,), weight=weights[i],
                shape=replace(shape, levels=shape.levels[i : i + 1], row_steps=shape.row_steps[i : i + 1]),
            )
            for i, seen in enumerate(self.silhouettes)
        ]  # fmt: skip

    def wider(self, by_m: float) -> Self:
        """Return the term of masks in which the outline of a hand is so much farther out than the hand's own."""
        return self._with(silhouettes=tuple(replace(s, wider_m=by_m) for s in self.silhouettes))

    def _with(self, **changes: object) -> Self:
        term = copy(self)
        vars(term).pop("_views", None)
        vars(term).update(changes)
        return term

    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        cost, grown = 0.0, bones.growth is not None and self.ellipsoids.grown(bones)
        frames, gathered = tuple(bones.frames), tuple(sums)
        for view, seen in zip(self._views, self.silhouettes, strict=True):
            flesh = grown.thicker(seen.wider_m).arrays if grown else view.ellipsoids
            observed = tuple(flesh), tuple(seen.arrays), tuple(view.field)
            part = silhouette_sums(frames, *observed, view.weight, gathered)
            cost += max(part + view.energy, 0.0)
        return cost

    @cached_property
    def _views(self) -> list[_View]:
        weights, views = per_camera(self.weight, len(self.silhouettes), "weight"), []
        for i, seen in enumerate(self.silhouettes):
            field, flesh = self.shape.of_camera(i), self.ellipsoids.thicker(seen.wider_m).arrays
            energy = 0.5 * weights[i] * seen.energy(field.step)
            views.append(_View(flesh, field, weights[i], energy))
        return views

    def linearize(self, bones: BonePoses, fields: BoneFields | None = None) -> JointSystem:
        if fields is None:
            return super().linearize(bones)
        grown, count = self.ellipsoids.grown(bones), fields.flesh.shape[-1]
        centre, shape = np.empty((len(grown), 3)), np.empty((len(grown), 3, 3))
        velocity, gradient = np.split(fields.flesh[grown.bone], [3], axis=1)
        gradient = gradient.reshape(-1, 3, 3, count)
        turn = 0.5 * (gradient - gradient.swapaxes(1, 2))
        cost, slope, hessian = 0.0, np.zeros(count), np.zeros((count, count))
        weights = per_camera(self.weight, len(self.silhouettes), "weight")
        for i, seen in enumerate(self.silhouettes):
            flesh = grown.thicker(seen.wider_m)
            posed_shapes(bones.frames, flesh.arrays, centre, shape)
            by_centre = velocity + np.einsum("eijn,ej->ein", gradient, centre - bones.reference)
            axes = bones.rotation[flesh.bone] @ flesh.rotation
            wide = (axes * flesh.radii[:, None]) @ axes.swapaxes(1, 2)
            own = (axes * (flesh.radii * grown.radii)[:, None]) @ axes.swapaxes(1, 2)
            by_shape = np.einsum("eikn,ekj->eijn", turn, shape)
            by_shape += np.einsum("eikn,ekj->eijn", gradient - turn, own)
            by_shape += by_shape.swapaxes(1, 2) + 2.0 * wide[..., None] * fields.outline
            ellipses, moments = (np.zeros((len(flesh) + 2, width)) for width in (ELLIPSE, MOMENTS))
            field, step = self.shape.of_camera(i), self.shape.row_step(i)
            camera_moments(centre, shape, seen.arrays, field, ellipses, moments)
            won = np.flatnonzero(moments[1:-1, 0])
            sums, observed = np.zeros((len(won), 6, 6)), np.zeros((len(won), 6))
            conic = np.zeros((len(won), 6))
            unpack_all(moments, ellipses, self.shape.levels[i], won, sums, observed, conic)
            by_unknown = conic_by(
                seen.camera.projection, ellipses[won], centre[won], shape[won],
                by_centre[won], by_shape[won], conic * self.shape.depth_scaled,
            )  # fmt: skip
            weight, summed = weights[i] * step, np.einsum("eij,ej->ei", sums, conic)
            core = moments[-1]
            part = 0.5 * core[0] + core[16] + (conic * (0.5 * summed - observed)).sum()
            cost += max(weight * part + 0.5 * weights[i] * seen.energy(step), 0.0)
            slope += weight * np.einsum("ein,ei->n", by_unknown, summed - observed)
            flat = by_unknown.reshape(-1, count)
            hessian += weight * flat.T @ (sums @ by_unknown).reshape(-1, count)
        return JointSystem(cost, slope, hessian)


def conic_by(
    projection: Floats[D3, D4],
    ellipses: Floats[E, D9],
    centre: Floats[E, D3],
    shape: Floats[E, D3, D3],
    by_centre: Floats[E, D3, N],
    by_shape: Floats[E, D3, D3, N],
    conic: Floats[E, D6],
) -> Floats[E, D6, N]:
    """Return how the field's numbers for (x², 2xy, y², 2x, 2y, 1) change with N unknowns, as `conic_by_twist` does for twists.

    centre, shape: of the ellipsoids, world; by_centre, by_shape: how they change; conic: the numbers themselves where their scale
    depends on depth, else 0. docs/explanation/silhouettes.md.
    """
    u0, v0, mu, mv, s11, s12, s22, gamma, s = ellipses.T
    matrix = np.repeat(projection[None], len(ellipses), axis=0)
    matrix[:, 0] -= u0[:, None] * projection[2]
    matrix[:, 1] -= v0[:, None] * projection[2]
    g = matrix[:, :, :3]
    p = np.einsum("eij,ej->ei", g, centre) + matrix[:, :, 3]
    dp = g @ by_centre
    dual = np.einsum("eia,eabn,ejb->eijn", g, by_shape, g)  # dC*
    dual -= dp[:, :, None] * p[:, None, :, None] + dp[:, None] * p[:, :, None, None]
    dual /= gamma[:, None, None, None]
    middle = np.stack([mu, mv], axis=1)
    s_matrix = np.stack([s11, s12, s12, s22], axis=1).reshape(-1, 2, 2)
    q = np.linalg.inv(s_matrix)
    third = dual[:, 2, 2]
    by_middle = dual[:, :2, 2] - middle[:, :, None] * third[:, None]
    mixed = middle[:, :, None, None] * by_middle[:, None]
    outer_middle = middle[:, :, None] * middle[:, None]
    by_s = mixed + mixed.swapaxes(1, 2) - dual[:, :2, :2]
    by_s += (outer_middle - s_matrix)[..., None] * third[:, None, None]
    by_q = -np.einsum("eij,ejkn,ekl->eiln", q, by_s, q)
    k = np.einsum("eij,ej->ei", q, middle)
    by_k = np.einsum("eijn,ej->ein", by_q, middle) + q @ by_middle
    level = np.einsum("ein,ei->en", by_k, middle) + np.einsum("ei,ein->en", k, by_middle)
    rows = [by_q[:, 0, 0], by_q[:, 0, 1], by_q[:, 1, 1], -by_k[:, 0], -by_k[:, 1], level]
    return s[:, None, None] * np.stack(rows, axis=1) - conic[:, :, None] * third[:, None]
