"""CloudRaysTerm: each cloud point's viewing ray meets the hand, its depth is right or an outlier.

A mismatch of a stereo pair moves a point along its viewing ray; its direction stays. Mathematics: docs/explanation/clouds.md.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from handtrack.arrays import D3, Floats, N, array_dataclass, check_shape
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.terms.bone_system import Sums
from handtrack.terms.clouds.cloud_rays_kernels import rays_sums
from handtrack.terms.loss import geman_mcclure, uniform_outliers
from handtrack.terms.term import SurfaceTerm, check_noise

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
