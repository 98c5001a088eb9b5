"""CollisionTerm: parts of the model do not overlap. docs/explanation/solver.md."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from handtrack.arrays import D2, Floats, Ints, K, array_dataclass, check_shape
from handtrack.errors import check_name
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.terms.bone_kernels import posed_shapes
from handtrack.terms.collision_kernels import collision_sums, overlaps
from handtrack.terms.term import Sums, SurfaceTerm, check_noise

_SOFT_M = 0.002
"""how far a finger's flesh gives way under a light touch: its pulp by 2 mm at a newton, and hardly further (Serina et al. 1997); as
much again costs ½"""


@lru_cache(maxsize=8)
def contact(model: ArticulatedModel) -> CollisionTerm:
    """Return the term that keeps a model's parts out of each other."""
    if model.kind == "body":
        return CollisionTerm.of(model)
    return CollisionTerm.of(model, "fine", _SOFT_M, _SOFT_M)


Collisions = tuple[tuple[Any, ...], Ints[K], Ints[K], float, float]
"""ellipsoids' arrays, first and second of each pair, slack and σ"""
_FIRM = 0.9
"""the share of each radius that does not give way; thighs are pressed flatter than wrists"""


@array_dataclass
class CollisionTerm(SurfaceTerm):
    """½ Σ ((−d − slack)₊/σ)² over pairs of ellipsoids, d their signed distance.

    Where two overlap, −d is how far one must move to be free of the other (the penetration depth); it has a row on both
    bones, along the shortest way out. Pairs that are apart cost nothing and are dismissed without computing d.
    """

    ellipsoids: Ellipsoids
    pairs: Ints[K, D2]
    """ellipsoids that may not overlap"""
    sigma_m: float = 0.01
    slack_m: float = 0.01
    """flesh gives way by this much before it counts"""
    name = "collision"

    def __post_init__(self) -> None:
        check_shape(self.pairs, (None, 2), f"{self.name}: pairs of ellipsoids")
        check_noise(self.name, self.sigma_m, self.slack_m)

    @classmethod
    def of(
        cls,
        model: ArticulatedModel,
        ellipsoid_set: str = "metaballs",
        sigma_m: float = 0.01,
        slack_m: float = 0.01,
    ) -> CollisionTerm:
        """Return the term of all parts of a model that are no neighbours, see `colliding_pairs`."""
        check_name("set of ellipsoids", ellipsoid_set, model.ellipsoids, f"the model {model.name}")
        chosen = model.ellipsoids[ellipsoid_set]
        chosen = replace(chosen, radii=_FIRM * chosen.radii)
        pairs = colliding_pairs(model, chosen, slack_m)
        return cls(chosen, pairs, sigma_m, slack_m)

    def depths(self, bones: BonePoses) -> Floats[K]:
        """Return how deep each pair overlaps [m], 0 where it does not; slack is not taken off."""
        return _depths(self.ellipsoids, bones, self.pairs)

    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        rescaled = self.ellipsoids.rescaled(bones)
        own = self.collisions
        if rescaled is not self.ellipsoids:
            own = rescaled.arrays, *own[1:]
        return collision_sums(bones.frames, own, sums)

    @cached_property
    def collisions(self) -> Collisions:
        """The same for compiled sums."""
        first, second = np.ascontiguousarray(np.asarray(self.pairs, np.int64).T)
        return self.ellipsoids.arrays, first, second, float(self.slack_m), float(self.sigma_m)


def colliding_pairs(
    model: ArticulatedModel, ellipsoids: Ellipsoids, slack_m: float = 0.01
) -> Ints[K, D2]:
    """Return the pairs of ellipsoids that can collide.

    Not those of one bone or of neighbouring bones, and not those of bones that overlap by more than the slack in the pose
    of rest already, for flesh joins them: shoulder and chest, the thighs' tops, thumb and palm.
    """
    parent = model.skeleton.parent
    first, second = np.triu_indices(len(ellipsoids), 1)
    a, b = ellipsoids.bone[first], ellipsoids.bone[second]
    apart = (a != b) & (parent[a] != b) & (parent[b] != a)
    pairs = np.stack([first, second], axis=1)[apart].astype(np.int64)
    if not len(pairs):
        return pairs
    joined = np.zeros((len(model.skeleton.bone_names),) * 2, bool)
    touching = pairs[_depths(ellipsoids, model.bones(model.rest_params()), pairs) > slack_m]
    joined[tuple(ellipsoids.bone[touching].T)] = True
    return pairs[~joined[tuple(ellipsoids.bone[pairs].T)]]


def _depths(ellipsoids: Ellipsoids, bones: BonePoses, pairs: Ints) -> Floats:
    place, shape = np.empty((len(ellipsoids), 3)), np.empty((len(ellipsoids), 3, 3))
    posed_shapes(bones.frames, ellipsoids.arrays, place, shape)
    found = np.empty(len(pairs))
    first, second = np.ascontiguousarray(np.asarray(pairs, np.int64).T)
    overlaps(place, shape, ellipsoids.radii.max(axis=1), first, second, found)
    return np.abs(found)
