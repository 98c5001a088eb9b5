"""Terms of measured points: their distance to the surface, along their rays, and the emptiness between camera and points."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from handtrack.arrays import (
    D3,
    D4,
    Array,
    Floats,
    Ints,
    K,
    M,
    N,
    V,
    X,
    Y,
    Z,
    array_dataclass,
    check_shape,
)
from handtrack.errors import HandtrackError
from handtrack.model.kinematics import BonePoses
from handtrack.model.metaballs import MetaballSurface
from handtrack.observation.observation import CloudView, view_centres
from handtrack.terms.cloud_kernels import BLOCK, aligned, arrange, cloud_sums
from handtrack.terms.cloud_rays_kernels import rays_sums
from handtrack.terms.distance_map_kernels import (
    emptiness_sums,
    fill_cells,
    fill_facing,
    fill_nearest,
    look_up,
    occlusion,
)
from handtrack.terms.loss import Loss, geman_mcclure, quadratic, uniform_outliers
from handtrack.terms.term import Sums, SurfaceTerm, check_noise

SPACING_M = 0.006
MOST_VOXELS = 8_000_000
"""The grid gets coarser rather than larger; about 150 MB are in use while this many are computed."""


class DistanceMap(NamedTuple):
    """Unsigned distances to a cloud: to the nearest of the points in those cells that are nearest to the 8 nodes around."""

    nearest: Array[X, Y, Z]
    """int32, the number of the filled cell nearest to each node; size 0 where there is no cloud at all"""
    first: Array[M]
    """int32, where the points of each cell begin, filled or not, and where the last ends"""
    points: Floats[N, D3]
    """the cloud in the box by cells, world [m]"""
    low: Floats[D3]
    """the first node, world [m]"""
    spacing: float
    """[m]"""

    @property
    def is_empty(self) -> bool:
        return self.nearest.size == 0

    def at_nodes(self) -> Array[X, Y, Z]:
        """Return the distance of each node, float32 [m]."""
        shape = self.nearest.shape
        along = (low + self.spacing * np.arange(n) for low, n in zip(self.low, shape, strict=True))
        nodes = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1)
        return self.at(nodes.reshape(-1, 3))[0].reshape(shape).astype(np.float32)

    def at(self, points: Floats[N, D3]) -> tuple[Floats[N], Floats[N, D3]]:
        """Return distance [m] and its gradient at points world; zeros without a cloud."""
        points = np.ascontiguousarray(points, dtype=float)
        check_shape(points, (None, 3), "points")
        distance, gradient = np.zeros(len(points)), np.zeros(points.shape)
        if not self.is_empty:
            look_up(self, points, 0.0, distance, gradient)
        return distance, gradient


def distance_map(
    points: Floats[N, D3],
    low: Floats[D3],
    high: Floats[D3],
    spacing_m: float = SPACING_M,
    most_voxels: int = MOST_VOXELS,
) -> DistanceMap:
    """Return the distance map of points in the box low, high, world [m]. 2004 paper, section 4.

    Points outside the box and points that are not finite are left out.
    """
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    if not (np.isfinite([low, high]).all() and (high > low).all() and spacing_m > 0):
        raise HandtrackError(
            f"distance map: box from {low} to {high} m, spacing {spacing_m:g} m; expected positive lengths."
        )
    spacing = max(spacing_m, float(np.prod(high - low) / most_voxels) ** (1 / 3))
    while np.prod(np.ceil((high - low) / spacing) + 1.0) > most_voxels:
        spacing *= 1.02
    x, y, z = np.ceil((high - low) / spacing).astype(int) + 1
    shape = int(x), int(y), int(z)
    points = np.asarray(points, dtype=float)
    check_shape(points, (None, 3), "cloud")
    with np.errstate(invalid="ignore"):
        inside = ((points >= low) & (points <= high)).all(axis=1)  # False for NaN
    points, found = np.ascontiguousarray(points[inside]), shape if inside.any() else (0, 0, 0)
    cells, nearest = np.empty(found, np.int32), np.empty(found, np.int32)
    ordered, first = fill_cells(points, low, spacing, cells)
    if len(points):
        fill_nearest(cells, nearest)
    return DistanceMap(nearest, first, ordered, low, float(spacing))


# ---- E1: the cloud's points lie on the merged surface. 2004 paper, section 4; mathematics: docs/explanation/clouds.md


FARTHEST_M = 1e6
"""A coordinate beyond this is no measurement."""


class PreparedCloud(NamedTuple):
    """A cloud in an order in which neighbours in memory are neighbours in space. Once a frame."""

    points: Floats[D3, M]
    """(3, N') world [m], rows x, y, z, filled up to a multiple of 8 with its last point"""
    count: int
    spheres: Floats[D4, K]
    """(4, blocks') centre and radius of each block of 32, filled up to a multiple of 8"""

    @property
    def rows(self) -> Floats[N, D3]:
        """The points, a row each."""
        return np.ascontiguousarray(self.points[:, : self.count].T)


def prepare_cloud(points: Floats[N, D3]) -> PreparedCloud:
    """Return points world [m] in compact blocks; what is not finite is left out."""
    points = np.asarray(points, dtype=float)
    check_shape(points, (None, 3), "cloud")
    with np.errstate(invalid="ignore"):
        finite = (np.abs(points) < FARTHEST_M).all(axis=1)  # False for NaN
    kept = np.ascontiguousarray(points[finite])
    along, count = np.arange(len(kept)), len(kept)
    arrange(kept, along, BLOCK)
    ordered = np.concatenate(
        [kept[along].T, np.repeat(kept[along[-1:]].T, -count % 8, axis=1)], axis=1
    )
    blocks = -(-count // BLOCK)
    spheres = np.zeros((4, blocks + -blocks % 8))
    if count:
        first = np.arange(blocks) * BLOCK
        low = np.minimum.reduceat(ordered, first, axis=1)
        high = np.maximum.reduceat(ordered, first, axis=1)
        spheres[:3, :blocks] = 0.5 * (low + high)
        off = ordered - np.repeat(spheres[:3], BLOCK, axis=1)[:, : ordered.shape[1]]
        furthest = np.maximum.reduceat((off**2).sum(axis=0), first)
        spheres[3, :blocks] = np.sqrt(furthest) * (1.0 + 1e-12)
    rows = aligned(ordered.size).reshape(3, -1)
    rows[:] = ordered
    return PreparedCloud(rows, count, spheres)


@array_dataclass
class CloudDistanceTerm(SurfaceTerm):
    """½ weight Σ ρ(d(X)²/σ²) over the cloud's points X, d the signed distance to the merged surface.

    A point moves no bone but the closest one's and those linked with it. The cloud stays, the bones move: a bone's
    entry is −w_e [n_e ; (X − o) × n_e], by its field −w_e [n_e ; n_e (X − o)ᵀ − d_e t tᵀ], t the direction of d_e.
    """

    cloud: PreparedCloud
    surface: MetaballSurface
    sigma_m: float = 0.002
    """how far a point is from the surface it was measured on"""
    loss: Loss = quadratic()
    weight: float = 1.0
    name = "cloud_distance"

    def __post_init__(self) -> None:
        check_noise(self.name, self.sigma_m)

    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        return cloud_sums(
            self.cloud,
            self.surface.posed(bones),
            self.sigma_m,
            self.loss,
            self.weight,
            bones.reference,
            sums,
        )


# ---- CloudRaysTerm: each cloud point's viewing ray meets the hand, its depth is right or an outlier
# A mismatch of a stereo pair moves a point along its viewing ray; its direction stays. Mathematics: docs/explanation/clouds.md.


OUTLIERS = uniform_outliers()
BESIDE_M, MISSED = 0.001, geman_mcclure(15.0)
"""by how much a ray may miss the model, and the loss of that"""


@array_dataclass
class CloudRaysTerm(SurfaceTerm):
    """½ weight Σ over the cloud's points: ρ_a(d²/along²) where a point's ray hits the model, ρ_b(s²/beside²) + an outlier's
    ρ_a where it passes by at the distance s.

    d: the point's signed distance to the ellipsoid that the ray hits first; behind its middle, as much deeper as the point
    is behind it. So a far side never explains a point.
    """

    points: Floats[N, D3]
    """finite, world [m]"""
    centre: Floats[D3]
    """of the camera whose pixels they are, world [m]"""
    surface: MetaballSurface
    along_m: float = 0.004
    """how far a point's depth is from the surface, where it is not wrong altogether"""
    weight: float = 1.0
    name = "cloud_rays"

    def __post_init__(self) -> None:
        check_shape(self.points, (None, 3), f"{self.name}: points")
        check_shape(self.centre, (3,), f"{self.name}: centre")
        check_noise(self.name, self.along_m)

    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        noise = self.along_m, OUTLIERS, BESIDE_M, MISSED
        surface = self.surface.posed(bones)
        return rays_sums(self._rays, surface, noise, self.weight, bones.reference, sums)

    @cached_property
    def _rays(self) -> tuple[Floats, Floats, Floats]:
        """Return the camera's centre, unit directions (N, 3) and distances (N,) [m] from it."""
        out = self.points - self.centre
        depth = np.linalg.norm(out, axis=1)
        return np.ascontiguousarray(self.centre, float), out / depth[:, None], depth


# ---- E2: the model's visible surface lies near the cloud. 2004 paper, section 4; docs/explanation/clouds.md


GRAZING = 0.25
"""cosine between normal and viewing ray below which a surface is seen too flatly to be asked for"""
CELL, DEPTH_STEP = 0.006, 0.012
"""[m] of the depth picture in which model points hide each other"""


@array_dataclass
class CloudEmptinessTerm(SurfaceTerm):
    """½ weight Σ ρ((D(X) − slack)₊²/σ²) over model surface points X, D the distance map of the cloud.

    The points are fixed to their bones; which are asked for is decided at the frame's start (`visible_from`). The model point moves: its bone's entry is
    +[n ; (X − o) × n] with n = ∇D, by its field [n ; n (X − o)ᵀ].
    """

    distances: DistanceMap
    bone: Ints[V]
    """the bone of each model point"""
    local: Floats[V, D3]
    """in that bone's frame [m]"""
    sigma_m: float = 0.004
    slack_m: float = 0.002
    """a cloud point this near is near enough: a filtered cloud's points are 2.5 mm apart"""
    loss: Loss = quadratic()
    weight: float = 1.0
    name = "cloud_emptiness"

    def __post_init__(self) -> None:
        check_shape(self.local, (len(self.bone), 3), f"{self.name}: model points")
        check_noise(self.name, self.sigma_m, self.slack_m)

    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        if self.distances.is_empty:
            return 0.0
        share = np.ones(len(self.bone))
        if bones.scale_change is not None:  # a larger hand's errors are alike over broader patches
            share /= bones.scale_change[self.bone].prod(axis=1) ** (2 / 3)
        surface = self.bone, bones.rescaled_surface(self.bone, self.local), share
        noise = self.slack_m, self.sigma_m, self.loss, self.weight
        return emptiness_sums(self.distances, bones.frames, surface, noise, sums)


def visible_from(
    points: Floats[V, D3],
    normals: Floats[V, D3],
    views: Sequence[CloudView],
    objects: Floats[M, D3] | None = None,
) -> Array[V]:
    """Return True where a view can have measured surface points with outward normals, world [m].

    A view is one depth camera, or the two of a stereo pair, which must both see a point.
    A point that faces away, or lies behind other points, can have no cloud: to ask for one would drag the model's
    back to the measured front. So it is behind objects (M, 3), measured points of something else, and beyond an image: a
    hand that is half in view would be drawn into it. No views: all True.
    """
    if not len(views):
        return np.ones(len(points), bool)
    seen = np.zeros(len(points), bool)
    everything = points if objects is None else np.concatenate([points, objects])
    for view in views:
        centres = view_centres(view)
        check_shape(centres, (None, 3), "camera centres of a view")
        by_all, facing = np.ones((2, len(points)), bool)
        for centre in centres:
            fill_facing(points, normals, centre, GRAZING, facing)
            by_all &= facing & ~hidden(points, everything, centre)
        for camera in view if isinstance(view, tuple) else ():
            by_all &= camera.shows(points)
        seen |= by_all
    return seen


def hidden(points: Floats[V, D3], others: Floats[M, D3], centre: Floats[D3]) -> Array[V]:
    """Return which points have one of others (M, 3) before them, nearer to a camera's centre on about the same line of sight."""
    return occlusion(points, others, centre, CELL, DEPTH_STEP)[0]


def hiding(points: Floats[V, D3], others: Floats[M, D3], centre: Floats[D3]) -> Array[M]:
    """Return which of others (M, 3) lie so before any of points (V, 3)."""
    return occlusion(points, others, centre, CELL, DEPTH_STEP)[1]
