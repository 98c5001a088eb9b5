"""Filters that keep the hand's points of a cloud: pure functions points → keep, and their chain.

After the point cloud paper, §2.3: distance to the previous hand, skin ellipse.
Every filter is deterministic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from handtrack.arrays import D2, D3, D4, Array, C, E, Floats, Ints, K, N, array_dataclass
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import above
from handtrack.setting import setting

# ---- Skin colour as an ellipse in (r, g) chromaticity, fitted from samples: r = R / (R + G + B), g = G / (R + G + B), so that
# brightness drops out


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


# ---- The filters, and their chain


_TREE_MOST = 60_000  # points that the outlier test looks at
_LINK_M = 0.015  # cells of a component: gaps up to about that size do not part it
_FAR_CELLS = 2**19  # cells beyond that from the middle count as one: their number fits 64 bits
_NEAR_SHARE = 0.01  # of a part's points: single stray ones do not bring it near
_LOOKED = 10  # of so many points one is asked where the middle is, or how far from a hand it is
_MIXERS = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB], np.uint64)
"""odd numbers without pattern (those of SplitMix64)"""
_LEAST_SHARE = 0.02  # of the points: a smaller component is no hand


@array_dataclass
class HandRegion:
    """Where a hand is expected: what clouds are cropped to."""

    balls: Floats[E, D4]
    """that hold the hand, a part each: centre, world [m], and radius [m]"""
    distance: Callable[[Floats[K, D3]], Floats[K]]
    """points, world [m] → distance [m] to the hand, no less than to the nearest ball"""

    def near(self, points: Floats[N, D3], reach_m: float) -> Array[N]:
        """Return which points lie within reach_m [m] of the hand."""
        found = self.around(points, reach_m)
        found[found] = self.distance(points[found]) <= reach_m
        return found

    def around(self, points: Floats[N, D3], reach_m: float) -> Array[N]:
        """Return which points lie within reach_m [m] of a ball: all that are so near to the hand, and some others."""
        from handtrack.capture.clouds.cell_kernels import near_balls  # the page does without Numba

        found = np.empty(len(points), bool)
        near_balls(np.ascontiguousarray(points, float), self.balls, reach_m, found)
        return found

    def is_about(self, other: HandRegion, room_m: float) -> bool:
        """Return whether what is around the other hand is around this one with room_m more reach."""
        if self.balls.shape != other.balls.shape:
            return False
        centre, radius = np.split(other.balls - self.balls, [3], axis=1)
        return bool((np.linalg.norm(centre, axis=1) + radius[:, 0] <= room_m).all())


@dataclass(frozen=True)
class FilterReport:
    """What one filter did to a cloud, for the screen."""

    name: str
    before: int
    after: int
    text: str
    """the filter with its settings, in words."""

    def __str__(self) -> str:
        return f"{self.text}: {self.before} → {self.after} points"


_Step = tuple[str, str, Callable[[PointCloud], Array]]
"""a filter's name, words for it, and which points of a cloud it keeps"""


@dataclass(frozen=True)
class CloudFilters:
    """The filters' settings, by their names in [clouds] of session.toml; None switches one off."""

    near_m: float | None = setting(
        0.1,
        "Points nearer to every camera are dropped.",
        label="Nearest cm",
        unit="m",
        above=0.0,
        slider=(0, 100, 1),
        page_unit=0.01,
    )
    far_m: float | None = setting(
        1.5,
        "Points farther from every camera are dropped.",
        label="Farthest cm",
        unit="m",
        above=0.0,
        slider=(0, 400, 5),
        page_unit=0.01,
    )
    crop_m: float | None = setting(
        0.1,
        "Largest distance to the previous frame's hand; without one, nothing is cropped.",
        label="To hand mm",
        unit="m",
        above=0.0,
        slider=(0, 300, 5),
        page_unit=0.001,
    )
    skin: SkinEllipse | None = setting(
        None,
        "Colours that count as skin, `mean`, `covariance` and `size` of an ellipse; clouds without colours pass.",
        label="Skin",
    )
    component: Literal["all", "nearest", "largest"] = setting(
        "all",
        "The connected part that is the hand: all, the nearest to the cameras, or the largest. "
        "For depth images the default is the nearest.",
        label="Piece kept",
        words={"all": "all", "nearest": "nearest to a camera", "largest": "largest"},
    )
    front_m: float | None = setting(
        None,
        "Depth of the nearest part, from its nearest point; separates a hand held out from the body "
        "behind it.",
        label="Its depth mm",
        unit="m",
        above=0.0,
        slider=(0, 500, 5),
        page_unit=0.001,
    )
    voxel_m: float | None = setting(
        0.0025,
        "Side of the cells in which points are thinned.",
        label="Cell mm",
        unit="m",
        above=0.0,
        slider=(0, 15, 0.25),
        page_unit=0.001,
    )
    per_voxel: int = setting(
        1, "Points that remain in each cell.", label="Points a cell", low=1, slider=(1, 20, 1)
    )
    outlier_neighbours: int | None = setting(
        8,
        "Number of neighbours whose mean distance identifies isolated points.",
        label="Neighbours",
        low=1,
        slider=(0, 40, 1),
    )
    outlier_ratio: float = setting(
        2.5,
        "Mean distance, in units of the cloud's median one, from which a point is an outlier.",
        label="Outlier ×",
        above=0.0,
        slider=(1.0, 8.0, 0.1),
    )
    max_points: int | None = setting(
        4000,
        "Number of points that remain, chosen at random.",
        label="Most points",
        low=1,
        slider=(0, 20000, 250),
    )
    seed: int = 0
    """of what is thinned at random; the tracker's `seed` sets it"""

    def apply(
        self,
        cloud: PointCloud,
        hand: HandRegion | None = None,
        centres: Floats[C, D3] | None = None,
    ) -> tuple[PointCloud, tuple[FilterReport, ...]]:
        """Return the hand's points, and what each filter did, in order.

        Parameters
        ----------
        hand
            Of the frame before; None skips the crop.
        centres
            World [m], the cameras' centres; None skips what depends on the distance to them.
        """
        fate, reports = self.dropped_by(cloud, hand, centres)
        return cloud.select(fate == len(reports)), reports

    def of_part(self, part: PointCloud, hand: HandRegion, centres: Floats[C, D3]) -> PointCloud:
        """Return what `apply` leaves of the whole cloud, of its part `around` a region that is about the hand."""
        return _kept(part, self._steps_of_hand(hand, centres))

    def around(
        self, cloud: PointCloud, hand: HandRegion, room_m: float, centres: Floats[C, D3]
    ) -> PointCloud:
        """Return a part of a cloud that is enough for every hand that `hand` is about, within room_m."""
        assert self.crop_m is not None
        whole_cells = 0.0 if self.voxel_m is None else np.sqrt(3.0) * self.voxel_m
        part = cloud.select(hand.around(cloud.points, self.crop_m + room_m + whole_cells))
        return _kept(part, self._steps_anywhere(centres))

    def dropped_by(
        self,
        cloud: PointCloud,
        hand: HandRegion | None,
        centres: Floats[C, D3] | None,
    ) -> tuple[Array[N], tuple[FilterReport, ...]]:
        """Return which filter dropped each point, by its place among the reports, and the
        reports; points that stay have the number after the last one.
        """
        steps = [*self._steps_anywhere(centres), *self._steps_of_hand(hand, centres)]
        fate = np.full(len(cloud), len(steps), np.int8)
        left, place = cloud, np.arange(len(cloud))
        reports: list[FilterReport] = []
        for number, (name, text, keep) in enumerate(steps):
            before = len(left)
            if before:
                kept = keep(left)
                if not kept.all():
                    fate[place[~kept]] = number
                    left, place = left.select(kept), place[kept]
            reports.append(FilterReport(name, before, len(left), text))
        return fate, tuple(reports)

    def _steps_anywhere(self, centres: Floats | None) -> Iterator[_Step]:
        """Yield the filters that are on and judge a point by itself and those in its cell, wherever the hand is: before the others,
        so that these see few points."""
        near, far, skin = self.near_m or 0.0, self.far_m or np.inf, self.skin
        if centres is not None and (self.near_m or self.far_m):
            text = f"{near:g} to {far:g} m from a camera"
            yield "range", text, lambda c: within_range(c.points, centres, near, far)
        if skin is not None:
            text = f"skin colour, ellipse of {skin.size:g} standard deviations"
            yield "skin", text, lambda c: skin_coloured(c, skin)
        if self.component == "all":
            yield from self._thinning()

    def _steps_of_hand(self, hand: HandRegion | None, centres: Floats | None) -> Iterator[_Step]:
        """Yield the other filters that are on."""
        crop, part, front = self.crop_m, self.component, self.front_m
        neighbours, most = self.outlier_neighbours, self.max_points
        if crop is not None and hand is not None:
            text = f"within {crop * 1e3:g} mm of the previous hand"
            yield "crop", text, lambda c: hand.near(c.points, crop)
        if part == "largest":
            yield "component", "the largest part", lambda c: largest_part(c.points)
        if part == "nearest" and centres is not None:
            reach = "" if front is None else f", {front * 1e3:g} mm deep"
            text = f"the part nearest to a camera{reach}"
            yield "component", text, lambda c: nearest_part(c.points, centres, front, hand)
        if part != "all":  # parts are told by their share of what cameras measured
            yield from self._thinning()
        if neighbours is not None:
            ratio = self.outlier_ratio
            text = f"mean distance to {neighbours} neighbours below {ratio:g} times the usual"
            yield "outliers", text, lambda c: inliers(c.points, neighbours, ratio, self.seed)
        if most is not None:
            text = f"at most {most}, at random"
            yield "most", text, lambda c: random_part(len(c), most, self.seed)

    def _thinning(self) -> Iterator[_Step]:
        voxel = self.voxel_m
        if voxel is not None:
            text = f"{self.per_voxel} in each cell of {voxel * 1e3:g} mm"
            yield "voxel", text, lambda c: thinned(c.points, voxel, self.per_voxel, self.seed)


def _kept(cloud: PointCloud, steps: Iterator[_Step]) -> PointCloud:
    """Return what filters leave of a cloud."""
    for _, _, keep in steps:
        if len(cloud):
            cloud = cloud.select(keep(cloud))
    return cloud


def finite(points: Floats[N, D3]) -> Array[N]:
    """Return which points have three finite coordinates."""
    return np.asarray(np.isfinite(points).all(axis=1))


def within_range(
    points: Floats[N, D3], centres: Floats[C, D3], near_m: float, far_m: float
) -> Array[N]:
    """Return which points lie in the range [m] of at least one camera at `centres`."""
    found, left = np.zeros(len(points), bool), slice(None)
    for centre in centres:
        away = points[left] - centre
        square = np.einsum("ij,ij->i", away, away)
        found[left] = (square >= near_m**2) & (square <= far_m**2)
        left = np.flatnonzero(~found)
    return found


def skin_coloured(cloud: PointCloud, skin: SkinEllipse) -> Array[N]:
    """Return which points' colours lie in the skin's ellipse; all where there are none."""
    if cloud.colors is None:
        return np.ones(len(cloud), bool)
    return np.less_equal(skin.distance(cloud.colors), skin.size)


def largest_part(points: Floats[N, D3]) -> Array[N]:
    """Return which points belong to the largest part that hangs together, by touching cells
    of side _LINK_M."""
    part = _parts(points)
    inside: Array = part == np.argmax(np.bincount(part))
    return inside


def nearest_part(
    points: Floats[N, D3],
    centres: Floats[C, D3],
    front_m: float | None = None,
    hand: HandRegion | None = None,
) -> Array[N]:
    """Return which points belong to the part nearest to a camera at `centres`; of a hand known
    beforehand, to the part that has most points about it, and to those nearer.

    Parts with less than a fiftieth of the points are not chosen; a part's distance is that of its
    nearest hundredth.

    Parameters
    ----------
    front_m
        Of that part, only what hangs together within front_m behind this distance [m] stays.
    """
    distance = np.min([np.linalg.norm(points - centre, axis=1) for centre in centres], axis=0)
    about = np.zeros(len(points), bool)
    if hand is not None:
        about[::_LOOKED] = hand.near(points[::_LOOKED], _LINK_M)
    inside, nearest = _nearest(points, distance, _LEAST_SHARE * len(points), about)
    if front_m is None:
        return inside
    front = np.flatnonzero(inside & (distance <= nearest + front_m))
    kept, _ = _nearest(points[front], distance[front], _LEAST_SHARE * len(front), about[front])
    inside[:] = False
    inside[front[kept]] = True
    return inside


def thinned(points: Floats[N, D3], voxel_m: float, per_voxel: int = 1, seed: int = 0) -> Array[N]:
    """Return which points stay when each cell of side voxel_m keeps per_voxel random ones: the same ones, whatever is in other
    cells."""
    from handtrack.capture.clouds.cell_kernels import number_cells  # the page does without Numba

    order = np.argsort(_lots(points, seed))
    _, before = number_cells(cell_numbers(points, voxel_m)[order])
    keep = np.zeros(len(points), bool)
    keep[order[before < per_voxel]] = True
    return keep


def _lots(points: Floats, seed: int) -> Ints:
    """Return numbers (N,) as good as random that follow from each point's place and the seed alone."""
    lots = np.ascontiguousarray(points, float).view(np.uint64) @ _MIXERS
    lots += np.random.default_rng(seed).integers(2**64, dtype=np.uint64)
    for mixer in _MIXERS[:2]:
        lots = (lots ^ (lots >> np.uint64(32))) * mixer
    return lots


def random_part(count: int, most: int, seed: int = 0) -> Array[N]:
    """Return a mask (count,) with at most `most` true, evenly at random, the same for one seed."""
    keep = np.ones(count, bool)
    if count > most:
        keep[:] = False
        keep[np.random.default_rng(seed).choice(count, most, replace=False)] = True
    return keep


def inliers(points: Floats[N, D3], neighbours: int, ratio: float, seed: int) -> Array[N]:
    """Return which points have their neighbours about as near as points usually have.

    The test wants an even density: thin first. Beyond 60,000 points, the rest is judged by the
    distance to those.
    """
    if len(points) <= neighbours:
        return np.ones(len(points), bool)  # too few to tell
    from scipy.spatial import KDTree

    seen = random_part(len(points), _TREE_MOST, seed)
    tree = KDTree(points[seen], leafsize=24, balanced_tree=False)
    distance = np.asarray(tree.query(points, k=neighbours + 1)[0])[:, 1:].mean(axis=1)
    return distance <= ratio * np.median(distance)


def cell_numbers(points: Floats[N, D3], side_m: float) -> Ints[N]:
    """Return one whole number per point, equal within a cell of one grid."""
    cells = np.floor(points / side_m)
    cells -= np.floor(np.median(cells[::_LOOKED], axis=0)) if len(cells) else 0.0
    whole = np.clip(cells, -_FAR_CELLS, _FAR_CELLS).astype(np.int64) + _FAR_CELLS
    size = 2 * _FAR_CELLS + 1
    return (whole[:, 0] * size + whole[:, 1]) * size + whole[:, 2]


def _parts(points: Floats) -> Ints:
    """Return the number of each point's part (N,), parts being groups of touching cells."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    from handtrack.capture.clouds.cell_kernels import number_cells  # the page does without Numba

    number, before = number_cells(cell_numbers(points, _LINK_M))
    cells = np.floor(points[before == 0] / _LINK_M)
    pairs = KDTree(cells).query_pairs(1.0, p=np.inf, output_type="ndarray").T
    graph = coo_array((np.ones(pairs.shape[1], bool), tuple(pairs)), (len(cells), len(cells)))
    return connected_components(graph, directed=False)[1].astype(np.int64)[number]


def _nearest(points: Floats, distance: Floats, least: float, about: Array) -> tuple[Array, float]:
    """Return which points (N, 3) are in the nearest part of at least `least` points, or in that with most points `about` a hand and
    those nearer, and the distance of its nearest hundredth."""
    part = _parts(points)
    sizes = np.bincount(part)
    candidates = np.flatnonzero(sizes >= min(least, sizes.max()))
    near = [float(np.quantile(distance[part == c], _NEAR_SHARE)) for c in candidates]
    first = int(np.argmin(near))
    if about.any():
        first = int(np.argmax([about[part == c].sum() for c in candidates]))
        return np.isin(part, candidates[np.array(near) <= near[first]]), near[first]
    inside: Array = part == candidates[first]
    return inside, near[first]
