"""Silhouettes as a search for the hand sees them: where a palm may be, how well a shape covers them, what pulls it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from handtrack.arrays import D3, Array, Floats, Ints, M, N, P, R, array_dataclass
from handtrack.geometry.camera import Camera
from handtrack.geometry.triangulation import triangulated
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import UNKNOWN, Silhouette
from handtrack.terms.silhouettes.prepared_silhouette import prepare
from handtrack.terms.silhouettes.silhouette_terms import CoverageTerm
from handtrack.terms.term import ObservationTerm
from handtrack.tracking.search.scores.hand_shapes import (
    PALM_DEEP_M,
    PIECE_M,
    HandShape,
    group_middles,
    palm_middle,
)
from handtrack.tracking.search.scores.score_kernels import silhouette_scores

_REACH_M = 0.4  # of the box around where the lines of sight meet: a hand and some arm
_SIDE_M = 0.01  # of a cell; twice that in the coarse grid, whose cells are halved
HAND_AREA_M2 = 0.012
"""of an open hand's outline: tells how deep it is where one camera alone sees it"""
_DEPTHS = (0.6, 1.6)


def visual_hull(silhouettes: Sequence[Silhouette]) -> tuple[Floats[N, D3], Floats[N]]:
    """Return cells of a centimetre that project into every silhouette that could see them, and how far inside their hull each lies, about [m];
    none where they disagree.

    A camera that a cell lies outside of says nothing about it; at least two must see it, or the only one there is.
    """
    from scipy.ndimage import distance_transform_edt

    seen = [s for s in silhouettes if (s.mask > 0.5).any()]
    if not seen:
        return np.zeros((0, 3)), np.zeros(0)
    outside: list[Floats] = [
        np.asarray(distance_transform_edt((s.mask <= 0.5) & (s.mask >= 0))) for s in seen
    ]
    cameras = [s.camera for s in seen]
    middle = _meeting_point(seen)
    coarse_m = 2.0 * _SIDE_M
    axis = np.arange(-_REACH_M, _REACH_M + 0.5 * coarse_m, coarse_m)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3) + middle
    if len(seen) == 1:
        far = np.linalg.norm(middle - cameras[0].centre)
        depth = cameras[0].to_camera(grid)[:, 2]
        grid = grid[(depth > _DEPTHS[0] * far) & (depth < _DEPTHS[1] * far)]
    coarse = grid[_inside(grid, cameras, outside, 0.87 * coarse_m)]
    halves = 0.5 * _SIDE_M * np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), -1)
    fine = (coarse[:, None] + halves.reshape(-1, 3)).reshape(-1, 3)
    fine = fine[_inside(fine, cameras, outside, 0.5 * _SIDE_M)]
    return fine, _depth(fine)


def _inside(
    points: Floats, cameras: Sequence[Camera], outside: Sequence[Floats], margin_m: float
) -> Array:
    """Return (N,) whether points lie within margin_m of all silhouettes that can see them."""
    keep, views = np.ones(len(points), bool), np.zeros(len(points), int)
    for camera, far in zip(cameras, outside, strict=True):
        depth = camera.to_camera(points)[:, 2]
        pixel = np.rint(np.nan_to_num(camera.project(points), nan=-1.0)).astype(int)
        width, height = camera.size
        within = (depth > 0) & (pixel >= 0).all(axis=1)
        within &= (pixel[:, 0] < width) & (pixel[:, 1] < height)
        margin = margin_m * float(camera.matrix[0, 0]) / np.maximum(depth, 1e-6)
        column, row = np.clip(pixel[:, 0], 0, width - 1), np.clip(pixel[:, 1], 0, height - 1)
        keep &= ~within | (far[row, column] <= margin)
        views += within
    return keep & (views >= min(2, len(cameras)))


def _meeting_point(seen: Sequence[Silhouette]) -> Floats:
    """Return (3,) the point nearest to the lines of sight of the silhouettes' middles, world [m]; NaN where they look along one line.

    With one camera, the point on its line at which the silhouette has a hand's area.
    """
    shown = [np.argwhere(silhouette.mask > 0.5)[:, ::-1] for silhouette in seen]
    middles = np.array([np.median(pixels, axis=0) for pixels in shown])
    cameras = [silhouette.camera for silhouette in seen]
    if len(seen) > 1:
        return triangulated(cameras, middles[:, None], 0.0)[0]
    per_rad = cameras[0].matrix[0, 0] * cameras[0].matrix[1, 1]
    depth = np.sqrt(HAND_AREA_M2 * per_rad / len(shown[0]))
    return cameras[0].centre + cameras[0].rays(middles[0]) * depth


def _depth(centres: Floats) -> Floats:
    from scipy.ndimage import distance_transform_edt

    if not len(centres):
        return np.zeros(0)
    low = centres.min(axis=0) - _SIDE_M
    cell = np.rint((centres - low) / _SIDE_M).astype(int)
    filled = np.zeros(tuple(cell.max(axis=0) + 2), bool)
    filled[tuple(cell.T)] = True
    return np.asarray(distance_transform_edt(filled))[tuple(cell.T)] * _SIDE_M - 0.5 * _SIDE_M


_PIXEL_M = 0.0035  # of the reduced pictures, at the hand's distance
_SAMPLES = 130  # mask pixels of a camera that are looked at in a score, within a hand's reach
_STEP_PX = 2
_MOST_SCORED = 4  # cameras
_PLACE_M, _MOST_PLACES = 0.025, 100
# of outline errors, in bands; along how much outline they stay the same
_SIGMA_BANDS, _CORRELATED_M = (0.35, 0.010)
_WIDE_PIXELS = 2.0
_LEAST_VISIBLE = 0.25  # share of a box that counts as the whole


@array_dataclass
class SilhouetteScore:
    """One frame's silhouettes, reduced; made by `silhouette_score`."""

    whole: tuple[Silhouette, ...]

    @cached_property
    def hull(self) -> tuple[Floats[N, D3], Floats[N]]:
        """Cells of what all show, world [m], and how far inside it each lies, about [m]."""
        return visual_hull(self.whole)

    @cached_property
    def small(self) -> list[Silhouette]:
        """The silhouettes at about 3.5 mm a pixel at the hand's distance."""
        middle = self.hull[0].mean(axis=0)
        return [_reduced(silhouette, middle) for silhouette in self.whole]

    @cached_property
    def places(self) -> Floats[M, D3]:
        """Where a palm's middle may be, world [m]: within the hull, its thickest parts first."""
        cells, depth = self.hull
        deep = depth > 0.5 * min(PALM_DEEP_M, float(depth.max(initial=0.0)))
        cells = cells[deep][np.argsort(-depth[deep], kind="stable")]
        # balls of that radius cannot cover more: a mask of the whole image would take for ever from small ones
        volume = int(deep.sum()) * _SIDE_M**3
        apart = max(_PLACE_M, (3 * volume / (4 * np.pi * _MOST_PLACES)) ** (1 / 3))
        chosen = group_middles(cells, apart)
        while len(chosen) > _MOST_PLACES:
            apart *= 1.15
            chosen = group_middles(cells, apart)
        return chosen

    @cached_property
    def _scored(self) -> tuple[Silhouette, ...]:
        """Return the silhouettes that scores look at: of many, those whose lines of sight differ most."""
        middle = self.hull[0].mean(axis=0)
        directions = np.stack([s.camera.centre - middle for s in self.small])
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        chosen = [0]
        while len(chosen) < min(_MOST_SCORED, len(self.small)):
            # seen from behind, an outline is the same
            similarity = np.abs(directions @ directions[chosen].T).max(axis=1)
            similarity[chosen] = np.inf
            chosen.append(int(np.argmin(similarity)))
        return tuple(self.small[i] for i in sorted(chosen))

    @cached_property
    def _pictures(self) -> tuple[Array, Ints]:
        """Return distances to the masks (C, H, W) [px] and how many columns and rows of each count (C, 2)."""
        from scipy.ndimage import distance_transform_edt

        far = [
            np.where(s.known, np.asarray(distance_transform_edt(s.mask <= 0.5)), 0.0)[
                ::_STEP_PX, ::_STEP_PX
            ]
            for s in self._scored
        ]
        sizes = np.array([[f.shape[1], f.shape[0]] for f in far], np.int64)
        whole = np.zeros((len(far), sizes[:, 1].max(), sizes[:, 0].max()), np.float32)
        for i, f in enumerate(far):
            whole[i, : f.shape[0], : f.shape[1]] = f
        return whole, sizes

    @cached_property
    def _samples(self) -> tuple[Floats, Ints, Floats]:
        """Return evenly spread mask pixels (N, 2) of all cameras, where each camera's begin, and their areas (C,) [px²]."""
        chosen, areas = [], []
        for silhouette in self._scored:
            row, column = np.nonzero((silhouette.mask > 0.5) & silhouette.known)
            hand = HAND_AREA_M2 / _PIXEL_M**2  # samples are that dense, however much arm there is
            every = max(1, round(np.sqrt(hand / _SAMPLES)))
            kept = (row % every == 0) & (column % every == 0)
            chosen.append(np.stack([column[kept], row[kept]], axis=1).astype(float))
            areas.append(float(every**2))
        start = np.cumsum([0, *map(len, chosen)]).astype(np.int64)
        return np.concatenate(chosen), start, np.array(areas)

    def scores(
        self,
        shape: HandShape,
        rotations: Floats[R, D3, D3],
        places: Floats[M, D3],
        enough: float = 1.0,
    ) -> Floats[R, M]:
        """Return the share of area on which shape and masks disagree, by rotation and place."""
        cameras, (points, normals, _) = [s.camera for s in self._scored], shape.samples
        return silhouette_scores(
            (np.stack([c.projection for c in cameras]), np.array([c.focal_px for c in cameras])),
            (*self._pictures, _STEP_PX),
            self._samples,
            (np.ascontiguousarray(rotations), np.ascontiguousarray(places)),
            (points, normals, shape.area, shape.middle, shape.reach),
            shape.spheres,
            enough,
        )

    def terms(
        self,
        shape: HandShape,
        model: ArticulatedModel,
        params: Floats[P],
        band_m: float,
        unbiased: bool,
        palms: Floats[M, D3] | None,
    ) -> list[ObservationTerm]:
        """Return coverage with a band around a pose of the shape's model, or of that without an arm: on small pictures where
        it is wide.

        Parameters
        ----------
        unbiased
            The antisymmetric ramp; in the wide one a model rests inside its mask, a finger by a
            millimetre at 4 mm.
        """
        bones, middle = model.bones(params), palm_middle(model, params)
        near, bands, weights = [], [], []
        for silhouette in self.small if band_m > _WIDE_PIXELS * _PIXEL_M else self.whole:
            boxed = _boxed(silhouette, middle[None] if palms is None else palms, shape.reach)
            if boxed is None:
                continue
            metre = float(silhouette.camera.pixels_per_m_at(middle))
            band = max(band_m * metre, 1.0)
            sigma = _SIGMA_BANDS * band_m * metre
            near.append(prepare(boxed))
            bands.append(band)
            # what is out of sight is taken to fit as badly as what is seen of the same hand
            seen = (boxed.valid[:, 1] - boxed.valid[:, 0]).sum() / (2 * shape.reach * metre) ** 2
            unseen = 1.0 / np.clip(seen, _LEAST_VISIBLE, 1.0)
            weights.append(unseen * 2 * band / (_CORRELATED_M * metre * sigma**2))
        if not near:
            return []
        return [CoverageTerm(near, model.ellipsoids["fine"], bands, bones, unbiased, weights)]

    def pieces(self, shape: HandShape, params: Floats[P]) -> float:
        """Return how many pieces of a hand's outline are seen about a pose."""
        middle, count = palm_middle(shape.model, params), 0.0
        for silhouette in self.whole:
            boxed = _boxed(silhouette, middle[None], shape.reach)
            if boxed is not None:
                metre = float(silhouette.camera.pixels_per_m_at(middle))
                count += boxed.outline_px / (metre * PIECE_M)
        return count


def silhouette_score(silhouettes: Sequence[Silhouette]) -> SilhouetteScore | None:
    """Return silhouettes made ready for the search; None where they outline nothing, or nothing in common."""
    seen = [s for s in silhouettes if (s.mask > 0.5).any() and not s.fills_image]
    score = SilhouetteScore(tuple(seen))
    return score if len(score.hull[0]) else None


def _reduced(silhouette: Silhouette, middle: Floats) -> Silhouette:
    """Return the silhouette with several pixels merged into one, about _PIXEL_M large at `middle` (3,)."""
    camera = silhouette.camera
    merged = min(max(1, round(_PIXEL_M * float(camera.pixels_per_m_at(middle)))), *camera.size)
    if merged == 1:
        return silhouette
    width, height = camera.size[0] // merged, camera.size[1] // merged
    cut = silhouette.mask[: height * merged, : width * merged]
    blocks = cut.reshape(height, merged, width, merged)
    mask = blocks.mean(axis=(1, 3), dtype=np.float32)
    mask[(blocks < 0).any(axis=(1, 3))] = UNKNOWN
    spans = silhouette.valid[: height * merged].reshape(height, merged, 2)
    valid = np.stack(
        [-(-spans[..., 0].max(axis=1) // merged), spans[..., 1].min(axis=1) // merged], 1
    )
    valid[valid[:, 0] >= valid[:, 1]] = 0
    matrix = camera.matrix / merged
    matrix[:2, 2] = (camera.matrix[:2, 2] + 0.5) / merged - 0.5  # whole numbers are pixel centres
    matrix[2, 2] = 1.0
    small = replace(camera, size=(width, height), matrix=matrix)
    return Silhouette(small, np.ascontiguousarray(mask), np.minimum(valid, width).astype(np.int32))


def _boxed(silhouette: Silhouette, palms: Floats[M, D3], reach: float) -> Silhouette | None:
    """Return the silhouette with only a box around hands at these palms that counts; None where that is out of sight."""
    camera = silhouette.camera
    depth = camera.to_camera(palms)[:, 2:]
    if depth.min() < 0.05:
        return None
    half = reach * camera.focal_px / depth
    left, top = (camera.project(palms) - half).min(axis=0)
    right, bottom = (camera.project(palms) + half).max(axis=0)
    rows = np.arange(camera.size[1])
    low = np.maximum(silhouette.valid[:, 0], np.ceil(left))
    high = np.minimum(silhouette.valid[:, 1], np.floor(right) + 1)
    seen = (top <= rows) & (rows <= bottom) & (low < high)
    if not seen.any():
        return None
    valid = np.where(seen[:, None], np.stack([low, high], axis=1), 0).astype(np.int32)
    return Silhouette(camera, silhouette.mask, valid)
