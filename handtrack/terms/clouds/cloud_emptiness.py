"""E2: the model's visible surface lies near the cloud. 2004 paper, section 4; docs/explanation/clouds.md."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import D3, Array, Floats, Ints, M, V, array_dataclass, check_shape
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import CloudView, view_centres
from handtrack.terms.bone_system import Sums
from handtrack.terms.clouds.distance_map import DistanceMap
from handtrack.terms.clouds.distance_map_kernels import emptiness_sums
from handtrack.terms.clouds.visibility_kernels import fill_facing, occlusion
from handtrack.terms.loss import Loss, quadratic
from handtrack.terms.term import SurfaceTerm, check_noise

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
