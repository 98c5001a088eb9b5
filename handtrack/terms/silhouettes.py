"""Silhouettes: a field painted by ellipsoids against a mask; conic (the 2007 paper's), or coverage, the default; how far both overlap."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Self

import cv2
import numpy as np

from handtrack.arrays import (
    D2,
    D3,
    D8,
    D13,
    D24,
    Array,
    B,
    C,
    E,
    Floats,
    H,
    Ints,
    K,
    N,
    W,
    array_dataclass,
    check_shape,
)
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.model.ellipsoids import Ellipsoids, model_mask
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.observation.observation import Silhouette
from handtrack.terms.row_kernels import fill_pieces, mark_edges
from handtrack.terms.silhouette_kernels import (
    CameraField,
    MaskArrays,
    overlap_areas,
    silhouette_sums,
)
from handtrack.terms.term import ObservationTerm, Sums

# ---- A mask as pieces of one value along its rows, made once a frame and shared by the terms


@array_dataclass
class PreparedSilhouette:
    """One camera's observation Z, ready for terms. Made by `prepare`, shared by all terms of a frame."""

    camera: Camera
    mask: MaskArrays
    row_energy: Floats[H]
    """Σ Z² over each row's valid pixels."""
    area: float
    """−Σ Z over valid pixels: the mask's area [px]."""
    wider_m: float = 0.0
    """by how much the outline of a hand is farther out in it than the hand's own, all along"""

    @property
    def outline_px(self) -> float:
        """How long the mask's outline is [px]: Crofton, by crossings of rows."""
        begins = self.mask.begins
        rows = np.repeat(np.arange(len(begins) - 1), np.diff(begins))
        crossed = (rows[1:] == rows[:-1]) & (np.abs(np.diff(self.mask.values)) > 0.5)
        return 0.5 * np.pi * float(crossed.sum())

    def energy(self, step: int) -> float:
        """Return Σ Z² over valid pixels, by one row of each `step`."""
        return step * float(self.row_energy[step // 2 :: step].sum())

    def times(self, factor: float) -> PreparedSilhouette:
        """Return the observation factor · Z; factor > 0."""
        return replace(
            self,
            mask=self.mask._replace(values=factor * self.mask.values),
            row_energy=factor**2 * self.row_energy,
            area=factor * self.area,
        )


def prepare(
    silhouette: Silhouette,
    line: Sequence[float] | None = None,
    observation: Array[H, W] | None = None,
) -> PreparedSilhouette:
    """Return a silhouette made ready for ConicFieldTerm and CoverageTerm.

    Parameters
    ----------
    line
        (a, b, c), pixels with a u + b v + c < 0 are not observed, see `clip_spans`.
    observation
        The observed field, ≤ 0, in place of −mask (the 2007 paper's simulated field images).

    Raises
    ------
    HandtrackError
        For wrong shapes and for values that are not finite numbers.
    """
    camera = silhouette.camera
    width, height = camera.size
    where = f"silhouette of camera '{camera.name}'"
    image = silhouette.mask if observation is None else np.asarray(observation, dtype=np.float64)
    check_shape(image, (height, width), where)
    check_shape(silhouette.valid, (height, 2), f"valid spans of the {where}")
    valid = np.clip(silhouette.valid, 0, width).astype(np.int32)
    if line is not None:
        valid = clip_spans(valid, line)
    image = np.ascontiguousarray(image, dtype=np.float32 if observation is None else np.float64)
    begins, edges = np.empty(height + 1, np.int64), np.empty((height, width // 8 + 1), np.uint8)
    count = mark_edges(image, edges, begins)
    ends, values, energy = np.empty(count, np.int64), np.empty(count), np.empty(height)
    sign = -1.0 if observation is None else 1.0
    area = fill_pieces(image, sign, valid, edges, begins, ends, values, energy)
    if not np.isfinite(energy).all():
        raise HandtrackError(
            f"{where}: it holds values that are not finite numbers; expected coverage from 0 to 1 (or a field ≤ 0)."
        )
    powers = power_sums(width), height_powers(height)
    mask = MaskArrays(valid, begins, ends, values, edges, *powers)
    return PreparedSilhouette(camera, mask, energy, float(area))


def clip_spans(valid: Array[H, D2], line: Sequence[float]) -> Array[H, D2]:
    """Return the spans without the pixels where a u + b v + c < 0. line: (a, b, c) [px]."""
    a, b, c = (float(x) for x in line)
    begin, end = valid[:, 0].astype(float), valid[:, 1].astype(float)
    level = b * np.arange(len(valid)) + c
    if a == 0.0:
        end = np.where(level >= 0, end, begin)
    else:
        # the division may round across a whole number: the sum itself decides the pixel next to it
        near = np.rint(-level / a)
        on_pixel = a * near + level >= 0
        if a > 0:
            begin = np.maximum(begin, near + ~on_pixel)
        else:
            end = np.minimum(end, near + on_pixel)
    spans = np.stack([begin, end], axis=1)
    spans[spans[:, 0] >= spans[:, 1]] = 0
    return spans.astype(np.int32)


@lru_cache(maxsize=16)
def power_sums(width: int) -> Floats[K, D8]:
    """Return (2W + 1, 8): row i holds Σ x⁰ … Σ x⁴ over whole x from −W to i − W − 1, and the first three again.

    Exact up to W ≈ 2000.
    """
    x = np.arange(-width, width, dtype=float)
    table = np.zeros((2 * width + 1, 8))
    table[1:] = np.cumsum(x[:, None] ** np.array([0, 1, 2, 3, 4, 0, 1, 2]), axis=0)
    return table


@lru_cache(maxsize=16)
def height_powers(height: int) -> Floats[K, D24]:
    """Return (2H + 1, 24): row j holds, with y = j − H, the power of y in each sum of MOMENTS."""
    y = np.arange(-height, height + 1, dtype=float)[:, None]
    powers = np.array([0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 3, 3, 4, 0, 0, 0, 0, 1, 1, 2, 0, 0])
    table = y**powers
    table[:, [15, 22, 23]] = 0.0
    return table


# ---- The terms


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


# ---- Overlap of the model's outline with the mask, per camera


@dataclass(frozen=True)
class OutlineOverlap:
    """Areas (C,) [px] within the observed pixels of each camera."""

    model: Floats[C]
    mask: Floats[C]
    both: Floats[C]

    @property
    def iou(self) -> Floats[C]:
        """Return intersection over union; 1 where neither is seen."""
        union = self.model + self.mask - self.both
        return np.where(union > 0, self.both / np.maximum(union, 1e-12), 1.0)


def outline_overlap(
    silhouettes: Sequence[Silhouette | PreparedSilhouette],
    ellipsoids: Ellipsoids,
    bones: BonePoses,
    row_step: int = 1,
) -> OutlineOverlap:
    """Return the areas of the model's hard outline, as far out as masks have it, of the masks, and
    of both together.

    Parameters
    ----------
    row_step
        Of how many rows one is looked at.
    """
    seen, whole = prepared(silhouettes), [np.arange(len(ellipsoids))]
    model, both = parts_overlap(seen, ellipsoids, whole, bones, row_step)[0].T
    return OutlineOverlap(model, np.array([camera.area for camera in seen]), both)


def parts_overlap(
    silhouettes: Sequence[PreparedSilhouette],
    ellipsoids: Ellipsoids,
    parts: Sequence[Ints[N]],
    bones: BonePoses,
    row_step: int = 1,
) -> Floats[N, C, D2]:
    """Return for each part alone, the ellipsoids of those numbers, the areas of its outline, and of
    outline and mask together.
    """
    rescaled = ellipsoids.rescaled(bones)
    starts = np.cumsum([0, *map(len, parts)])
    members = np.concatenate([*parts, np.empty(0, np.int64)]).astype(np.int64)
    areas = np.zeros((len(silhouettes), len(parts), 2))
    for seen, found in zip(silhouettes, areas, strict=True):
        arrays = rescaled.thicker(seen.wider_m).arrays
        view = seen.camera.projection, seen.mask
        overlap_areas(bones.frames, arrays, *view, starts, members, row_step, found)
    return areas.swapaxes(0, 1)


# ---- The largest connected piece of a mask that no part of the model covers: a finger that is elsewhere, not a rim


THICK_M = (
    0.010  # thinner is a rim by which a mask is wider than the model, or the model another person's
)


def unexplained_mm2(
    silhouettes: Sequence[PreparedSilhouette],
    pixels_per_m: Sequence[float],
    ellipsoids: Ellipsoids,
    bones: BonePoses,
) -> Floats[C]:
    """Return the area [mm²] of the largest connected piece of each mask beside the model, at the hand's distance.

    It is what circles of 10 mm can sweep: a rim is thinner, a finger that the model has elsewhere is not, however small its
    share of the overlap. What is not observed or not known counts as covered.
    """
    posed = ellipsoids.posed(bones)
    found = np.zeros(len(silhouettes))
    for row, (silhouette, scale) in enumerate(zip(silhouettes, pixels_per_m, strict=True)):
        left = _mask(silhouette) & ~model_mask(silhouette.camera, posed)
        if left.any():
            _, areas = pieces(left, 0.5 * THICK_M * scale)
            found[row] = areas.max(initial=0.0) * (1e3 / scale) ** 2
    return found


def pieces(left: Array[H, W], radius: float) -> tuple[Ints[H, W], Floats[N]]:
    """Return the connected pieces that circles of a radius [px] sweep, numbered from 1, and their areas [px]."""
    middle = (
        cv2.distanceTransform(np.pad(left, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        >= radius
    )
    if not middle.any():
        return np.zeros(left.shape, np.int32), np.zeros(0)
    away = cv2.distanceTransform((~middle).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    labels, about = cv2.connectedComponentsWithStats((away <= radius).astype(np.uint8))[1:3]
    labels, areas = labels[1:-1, 1:-1], about[1:, cv2.CC_STAT_AREA].astype(float)
    return np.asarray(labels, np.int32), areas


def _mask(silhouette: PreparedSilhouette) -> Array[H, W]:
    """Return where the mask surely shows the hand."""
    width, height = silhouette.camera.size
    mask = silhouette.mask
    begins = np.zeros(len(mask.ends), np.int64)
    begins[1:] = mask.ends[:-1]
    begins[mask.begins[:-1]] = 0
    values = np.repeat(mask.values, mask.ends - begins).reshape(height, width)
    column = np.arange(width)
    observed = (column >= mask.valid[:, :1]) & (column < mask.valid[:, 1:])
    return observed & (values < -0.5)
