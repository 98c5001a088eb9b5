"""MetaballSurface: ellipsoids merged into one surface, its signed distance and gradient.

2004 paper, sections 3.2 and 3.3. Mathematics: docs/explanation/clouds.md.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from handtrack.arrays import D3, D16, Array, E, Floats, Ints, K, L, N, array_dataclass, check_shape
from handtrack.errors import HandtrackError, check_name
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.model.skeleton import Skeleton
from handtrack.model.surfaces.metaballs_kernels import merged_distance, pose_table

FORMS = {"d1": np.inf, "d2": 0.0, "d3": 1.0}
"""Distances to one ellipsoid: the level k below which d1's form (k − 1) r_min holds, d2's beyond."""

SHARPNESS_PER_M = 1000.0
"""β of a hand of scale 1. The 2004 paper does not state its unit; 1/mm rounds creases by about a millimetre."""


@array_dataclass
class MetaballSurface:
    """d = −(1/β) log Σ exp(−β d_e) over the closest ellipsoid and those linked with it.

    Fingers are not linked with each other, so they never merge. Where the closest ellipsoid changes the sum has other
    members, and d may jump by a little.
    """

    ellipsoids: Ellipsoids
    linked: Array[E, E]
    """bool, symmetric, True on the diagonal"""
    sharpness: float = SHARPNESS_PER_M
    """β [1/m]: n equally close linked ellipsoids move the surface outwards by log(n)/β"""
    form: str = "d3"
    """distance to one ellipsoid: `d1`, `d2` or `d3`"""

    def __post_init__(self) -> None:
        check_name("distance to an ellipsoid", self.form, FORMS)
        if not 0.0 < self.sharpness < np.inf:
            raise HandtrackError(
                f"metaballs: sharpness {self.sharpness:g} per metre; expected a positive number such as "
                f"{SHARPNESS_PER_M:g}."
            )
        check_shape(self.linked, (len(self.ellipsoids), len(self.ellipsoids)), "linked ellipsoids")

    @classmethod
    def of(
        cls,
        model: ArticulatedModel,
        sharpness: float = SHARPNESS_PER_M,
        form: str = "d3",
        ellipsoid_set: str = "metaballs",
    ) -> MetaballSurface:
        """Return a model's surface. sharpness: β [1/m] of a hand of scale 1; larger hands are as round as small ones."""
        check_name("set of ellipsoids", ellipsoid_set, model.ellipsoids, f"the model {model.name}")
        ellipsoids = model.ellipsoids[ellipsoid_set]
        linked = linked_ellipsoids(model.skeleton, ellipsoids)
        return cls(ellipsoids, linked, sharpness / model.scale.overall, form)

    @property
    def turning_level(self) -> float:
        """The level k below which the distance to an ellipsoid is (k − 1) r_min."""
        return FORMS[self.form]

    @cached_property
    def links(self) -> tuple[Ints[K], Ints[L]]:
        """Return (start (E + 1,), members): who sums with e, itself first, is members[start[e] : start[e + 1]]."""
        members = [
            [e, *(int(i) for i in np.flatnonzero(row) if i != e)]
            for e, row in enumerate(self.linked)
        ]
        start = np.cumsum([0, *map(len, members)])
        return start.astype(np.int64), np.array([i for row in members for i in row], np.int64)

    def posed(
        self, bones: BonePoses
    ) -> tuple[Floats[E, D16], Ints[E], Ints[K], Ints[L], float, float]:
        """Return the surface at these poses, for compiled code: a table as metaballs_kernels.py says, each ellipsoid's bone, `links`,
        sharpness and `turning_level`.
        """
        ellipsoids = self.ellipsoids.rescaled(bones).arrays
        table = np.empty((len(ellipsoids[0]), 16))
        pose_table(bones.frames, ellipsoids, table)
        return table, ellipsoids[0], *self.links, self.sharpness, self.turning_level

    def near(
        self, bones: BonePoses, points: Floats[N, D3]
    ) -> tuple[Floats[N], Ints[N], Floats[N, D3]]:
        """Return signed distance [m], closest ellipsoid and the distance's gradient, about unit length near the surface, at points world [m];
        NaN at NaN.
        """
        return self._merged(bones, points, True)

    def distance(self, bones: BonePoses, points: Floats[N, D3]) -> Floats[N]:
        """Return the signed distance [m] of points world, negative inside."""
        return self._merged(bones, points, False)[0]

    def _merged(
        self, bones: BonePoses, points: Floats[N, D3], want_gradient: bool
    ) -> tuple[Floats[N], Ints[N], Floats[N, D3]]:
        points = np.ascontiguousarray(points, dtype=float)
        check_shape(points, (None, 3), "points")
        distance, closest = np.empty(len(points)), np.empty(len(points), np.int64)
        gradient = np.empty(points.shape if want_gradient else (0, 3))
        merged_distance(points, self.posed(bones), want_gradient, distance, closest, gradient)
        return distance, closest, gradient

    def projected(self, bones: BonePoses, points: Floats[N, D3], steps: int = 6) -> Floats[N, D3]:
        """Return points moved along the gradient onto the surface d = 0 (Newton's steps, some millimetres)."""
        points = np.array(points, dtype=float)
        for _ in range(steps):
            distance, _, gradient = self.near(bones, points)
            size = np.maximum((gradient**2).sum(axis=1), 0.05)
            points -= (distance / size)[:, None] * gradient
        return points


def linked_ellipsoids(skeleton: Skeleton, ellipsoids: Ellipsoids) -> Array[E, E]:
    """Return True where two ellipsoids share a bone, or one's bone is the next with flesh above the other's; bones that do not move
    against each other are one.

    So the palm is linked with the first bone of each finger, and fingers are not linked with each other.
    """
    carrier = np.arange(skeleton.bone_count)
    for b in range(1, len(carrier)):
        if b not in skeleton.hinge_bone:
            carrier[b] = carrier[skeleton.parent[b]]
    bone = carrier[ellipsoids.bone]
    above = np.full(len(carrier), -1)
    for b in set(bone.tolist()):
        parent = b
        while parent >= 0 and (parent == b or parent not in bone):
            parent = int(carrier[skeleton.parent[parent]]) if parent else -1
        above[b] = parent
    over = above[bone][:, None] == bone[None, :]
    return (bone[:, None] == bone[None, :]) | over | over.T
