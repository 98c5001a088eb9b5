"""E1: the cloud's points lie on the merged surface. 2004 paper, section 4; mathematics: docs/explanation/clouds.md."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handtrack.arrays import D3, D4, Floats, K, M, N, array_dataclass, check_shape
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.terms.bone_system import Sums
from handtrack.terms.clouds.cloud_kernels import BLOCK, aligned, arrange, cloud_sums
from handtrack.terms.loss import Loss, quadratic
from handtrack.terms.term import SurfaceTerm, check_noise

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
