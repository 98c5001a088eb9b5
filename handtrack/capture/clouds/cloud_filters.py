"""Filters that keep the hand's points of a cloud: pure functions points → keep, and their chain.

After the point cloud paper, §2.3: distance to the previous hand, skin ellipse; and mission B4.
Every filter is deterministic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from handtrack.arrays import D3, Array, C, Floats, Ints, N
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.capture.clouds.skin_ellipse import SkinEllipse
from handtrack.setting import setting

HandDistance = Callable[[Floats[N, D3]], Floats[N]]
"""points, world [m] → distance [m] to the hand of the frame before."""

_AT_ONCE = 100_000  # points handed to the distance function: bounds its memory
_TREE_MOST = 60_000  # points that the outlier test looks at
_LINK_M = 0.015  # cells of a component: gaps up to about that size do not part it
_FAR_CELLS = 2**19  # cells beyond that from the middle count as one: their number fits 64 bits
_NEAR_SHARE = 0.01  # of a part's points: single stray ones do not bring it near
_LOOKED = 10  # of so many points one is asked where the middle is, or how far from a hand it is
_LEAST_SHARE = 0.02  # of the points: a smaller component is no hand


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
        hand_distance: HandDistance | None = None,
        centres: Floats[C, D3] | None = None,
    ) -> tuple[PointCloud, tuple[FilterReport, ...]]:
        """Return the hand's points, and what each filter did, in order.

        Parameters
        ----------
        hand_distance
            Of the frame before; None skips the crop.
        centres
            World [m], the cameras' centres; None skips what depends on the distance to them.
        """
        fate, reports = self.dropped_by(cloud, hand_distance, centres)
        return cloud.select(fate == len(reports)), reports

    def dropped_by(
        self,
        cloud: PointCloud,
        hand_distance: HandDistance | None,
        centres: Floats[C, D3] | None,
    ) -> tuple[Array[N], tuple[FilterReport, ...]]:
        """Return which filter dropped each point, by its place among the reports, and the
        reports; points that stay have the number after the last one.
        """
        steps = list(self._steps(hand_distance, centres))
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

    def _steps(
        self, hand_distance: HandDistance | None, centres: Floats | None
    ) -> Iterator[tuple[str, str, Callable[[PointCloud], Array]]]:
        """Yield name, words and function of the filters that are on: the cheap ones first, so
        that the dear ones see few points."""
        near, far, crop = self.near_m or 0.0, self.far_m or np.inf, self.crop_m
        skin, part, front = self.skin, self.component, self.front_m
        voxel, neighbours, most = self.voxel_m, self.outlier_neighbours, self.max_points
        if centres is not None and (self.near_m or self.far_m):
            text = f"{near:g} to {far:g} m from a camera"
            yield "range", text, lambda c: within_range(c.points, centres, near, far)
        if crop is not None and hand_distance is not None:
            text = f"within {crop * 1e3:g} mm of the previous hand"
            yield "crop", text, lambda c: near_hand(c.points, hand_distance, crop)
        if skin is not None:
            text = f"skin colour, ellipse of {skin.size:g} standard deviations"
            yield "skin", text, lambda c: skin_coloured(c, skin)
        if part == "largest":
            yield "component", "the largest part", lambda c: largest_part(c.points)
        if part == "nearest" and centres is not None:
            reach = "" if front is None else f", {front * 1e3:g} mm deep"
            text = f"the part nearest to a camera{reach}"
            yield (
                "component",
                text,
                lambda c: nearest_part(c.points, centres, front, hand_distance),
            )
        if voxel is not None:
            text = f"{self.per_voxel} in each cell of {voxel * 1e3:g} mm"
            yield "voxel", text, lambda c: thinned(c.points, voxel, self.per_voxel, self.seed)
        if neighbours is not None:
            ratio = self.outlier_ratio
            text = f"mean distance to {neighbours} neighbours below {ratio:g} times the usual"
            yield "outliers", text, lambda c: inliers(c.points, neighbours, ratio, self.seed)
        if most is not None:
            text = f"at most {most}, at random"
            yield "most", text, lambda c: random_part(len(c), most, self.seed)


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


def near_hand(points: Floats[N, D3], hand_distance: HandDistance, crop_m: float) -> Array[N]:
    """Return which points lie within crop_m [m] of the hand of the frame before."""
    parts = range(0, len(points), _AT_ONCE)
    return np.concatenate(
        [hand_distance(points[i : i + _AT_ONCE]) <= crop_m for i in parts] or [np.zeros(0, bool)]
    )


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
    hand_distance: HandDistance | None = None,
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
    if hand_distance is not None:
        about[::_LOOKED] = hand_distance(points[::_LOOKED]) < _LINK_M
    inside, nearest = _nearest(points, distance, _LEAST_SHARE * len(points), about)
    if front_m is None:
        return inside
    front = np.flatnonzero(inside & (distance <= nearest + front_m))
    kept, _ = _nearest(points[front], distance[front], _LEAST_SHARE * len(front), about[front])
    inside[:] = False
    inside[front[kept]] = True
    return inside


def thinned(points: Floats[N, D3], voxel_m: float, per_voxel: int = 1, seed: int = 0) -> Array[N]:
    """Return which points stay when each cell of side voxel_m keeps per_voxel random ones."""
    from handtrack.capture.clouds.cell_kernels import number_cells  # the page does without Numba

    order = np.random.default_rng(seed).permutation(len(points))
    _, before = number_cells(cell_numbers(points, voxel_m)[order])
    keep = np.zeros(len(points), bool)
    keep[order[before < per_voxel]] = True
    return keep


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
    tree = KDTree(points[seen])
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
