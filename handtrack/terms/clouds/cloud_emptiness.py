"""E2: the model's visible surface lies near the cloud. 2004 paper, section 4; docs/derivations/clouds.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from handtrack.arrays import D3, Array, Floats, Ints, K, N, V, check_shape
from handtrack.errors import HandtrackError
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.surface_mesh import SurfaceMesh
from handtrack.terms.clouds.distance_map import MOST_VOXELS, SPACING_M, DistanceMap, distance_map
from handtrack.terms.clouds.distance_map_kernels import emptiness_kernel, emptiness_system
from handtrack.terms.compiled_term import CompiledTerm
from handtrack.terms.loss import Loss, Quadratic, compiled_loss
from handtrack.terms.term_table import TermTable

GRAZING = 0.25
"""cosine between normal and viewing ray below which a surface is seen too flatly to be asked for"""
CELL, DEPTH_STEP = 0.006, 0.012
"""[m] of the depth picture in which model points hide each other"""


@dataclass(frozen=True, eq=False)
class CloudEmptinessTerm(CompiledTerm):
    """½ weight Σ ρ((D(X) − slack)₊²/σ²) over model surface points X, D the distance map of the cloud.

    The points are fixed to their bones at the frame's start. The model point moves: its bone's entry is
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
    loss: Loss = Quadratic()
    weight: float = 1.0
    name: str = "cloud_emptiness"

    def __post_init__(self) -> None:
        check_shape(self.local, (len(self.bone), 3), f"{self.name}: model points")
        if not (0.0 < self.sigma_m < np.inf and self.slack_m >= 0.0):
            raise HandtrackError(
                f"{self.name}: sigma {self.sigma_m:g} m and slack {self.slack_m:g} m; expected positive lengths."
            )
        _ = self._loss

    @classmethod
    def at_start(
        cls,
        cloud: Floats[N, D3],
        mesh: SurfaceMesh,
        views: Sequence[Floats[K, D3]] = (),
        *,
        margin_m: float = 0.04,
        spacing_m: float = SPACING_M,
        most_voxels: int = MOST_VOXELS,
        sigma_m: float = 0.004,
        slack_m: float = 0.002,
        loss: Loss = Quadratic(),
        weight: float = 1.0,
    ) -> CloudEmptinessTerm:
        """Return the term of a cloud world [m] and the mesh of the model where the frame starts.

        views: what can have seen the surface, see `seen_from`; without any, the whole surface is asked for.
        margin_m: how far the map reaches beyond the mesh; points beyond it are left out.
        """
        low, high = mesh.vertices.min(axis=0) - margin_m, mesh.vertices.max(axis=0) + margin_m
        distances = distance_map(cloud, low, high, spacing_m, most_voxels)
        nothing = np.empty(0, np.int64), np.empty((0, 3))
        return cls(distances, *nothing, sigma_m, slack_m, loss, weight).for_mesh(mesh, views)

    def for_mesh(
        self, mesh: SurfaceMesh, views: Sequence[Floats[K, D3]] = ()
    ) -> CloudEmptinessTerm:
        """Return the term of the same cloud for another mesh of the model."""
        kept = seen_from(mesh.vertices, mesh.normals, views)
        return replace(self, bone=mesh.bone[kept], local=np.ascontiguousarray(mesh.local[kept]))

    def _accumulate(self, bones: BonePoses, width: int, gradient: Floats, hessian: Floats) -> float:
        if self.distances.is_empty:
            return 0.0
        kind, scale = self._loss
        share = np.ones(len(self.bone))
        if bones.growth is not None:  # a larger hand's errors are alike over broader patches
            share /= bones.growth[self.bone].prod(axis=1) ** (2 / 3)
        return emptiness_system(
            self.distances.nearest,
            self.distances.first,
            self.distances.points,
            self.distances.low,
            self.distances.spacing,
            bones.rotation,
            bones.position,
            bones.reference,
            self.bone,
            bones.on_flesh(self.bone, self.local),
            share,
            self.slack_m,
            self.sigma_m,
            kind,
            scale,
            self.weight,
            width,
            gradient,
            hessian,
        )

    def tables(self) -> list[TermTable]:
        if self.distances.is_empty:
            return []
        found = self.distances
        scalars = found.spacing, self.slack_m, self.sigma_m, *self._loss, self.weight
        return [
            TermTable(
                emptiness_kernel, found.nearest, found.first, found.points, found.low, self.bone, self.local, np.array(scalars)
            )
        ]  # fmt: skip

    @cached_property
    def _loss(self) -> tuple[int, float]:
        return compiled_loss(self.loss, self.name)


def seen_from(
    points: Floats[V, D3], normals: Floats[V, D3], views: Sequence[Floats[K, D3]]
) -> Array[V]:
    """Return True where a view can have measured surface points with outward normals, world [m].

    A view is the centres of cameras that must all see a point: one for a depth camera, two for a stereo pair.
    A point that faces away, or lies behind other points, can have no cloud: to ask for one would drag the model's
    back to the measured front. No views: all True.
    """
    if not len(views):
        return np.ones(len(points), bool)
    seen = np.zeros(len(points), bool)
    for view in views:
        centres = np.atleast_2d(np.asarray(view, dtype=float))
        check_shape(centres, (None, 3), "camera centres of a view")
        by_all = np.ones(len(points), bool)
        for centre in centres:
            by_all &= _faces(points, normals, centre) & _in_front(points, centre)
        seen |= by_all
    return seen


def _faces(points: Floats, normals: Floats, centre: Floats) -> Array:
    ray = centre - points
    return (normals * ray).sum(axis=1) > GRAZING * np.linalg.norm(ray, axis=1)


def _in_front(points: Floats, centre: Floats) -> Array:
    """Return (V,) True where no other point hides a point: a coarse depth picture of the points themselves."""
    out = points - centre
    middle = out.mean(axis=0)
    far = float(np.linalg.norm(middle))
    if far < 1e-6:
        return np.ones(len(points), bool)
    z = middle / far
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    depth = out @ z
    flat = (
        np.stack([out @ x, out @ np.cross(z, x)], axis=1) * (far / np.maximum(depth, 1e-3))[:, None]
    )
    cell = np.floor((flat - flat.min(axis=0)) / CELL).astype(np.int64)
    width = int(cell[:, 1].max()) + 1
    place = cell[:, 0] * width + cell[:, 1]
    nearest = np.full(int(place.max()) + 1, np.inf)
    np.minimum.at(nearest, place, depth)
    return depth <= nearest[place] + DEPTH_STEP
