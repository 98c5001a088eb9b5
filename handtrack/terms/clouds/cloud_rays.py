"""CloudRaysTerm: each cloud point's viewing ray meets the hand, its depth is right or an outlier.

A mismatch of a stereo pair moves a point along its viewing ray; its direction stays. Mathematics: docs/explanation/clouds.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from handtrack.arrays import D3, Floats, N, check_shape
from handtrack.errors import HandtrackError
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.terms.clouds.cloud_rays_kernels import rays_kernel, rays_system
from handtrack.terms.compiled_term import CompiledTerm
from handtrack.terms.loss import GemanMcClure, UniformOutliers
from handtrack.terms.term_table import TermTable


@dataclass(frozen=True, eq=False)
class CloudRaysTerm(CompiledTerm):
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
    beside_m: float = 0.001
    """by how much a ray may miss the model"""
    outliers: UniformOutliers = UniformOutliers()
    robust: GemanMcClure = GemanMcClure(15.0)
    weight: float = 1.0
    name: str = "cloud_rays"

    def __post_init__(self) -> None:
        check_shape(self.points, (None, 3), f"{self.name}: points")
        check_shape(self.centre, (3,), f"{self.name}: centre")
        if not (0.0 < self.along_m < np.inf and 0.0 < self.beside_m < np.inf):
            raise HandtrackError(
                f"{self.name}: sigmas {self.along_m:g} m along and {self.beside_m:g} m beside; expected positive lengths."
            )

    def _accumulate(self, bones: BonePoses, width: int, gradient: Floats, hessian: Floats) -> float:
        rays, depth = self._rays
        return rays_system(
            self.centre,
            rays,
            depth,
            self.surface.posed(bones),
            self.surface.ellipsoids.bone,
            self.beside_m,
            self.robust.scale,
            self.along_m,
            self.outliers.level,
            self.weight,
            bones.reference,
            width,
            gradient,
            hessian,
        )

    def tables(self) -> list[TermTable]:
        rays, depth = self._rays
        flesh = self.surface.ellipsoids
        scalars = self.beside_m, self.robust.scale, self.along_m, self.outliers.level, self.weight
        return [
            TermTable(
                rays_kernel, self.centre, rays, depth, flesh.bone, flesh.centre, flesh.rotation, flesh.radii,
                np.array(scalars),
            )
        ]  # fmt: skip

    @cached_property
    def _rays(self) -> tuple[Floats, Floats]:
        """Return unit directions (N, 3) and distances (N,) [m] from the camera's centre."""
        out = self.points - self.centre
        depth = np.linalg.norm(out, axis=1)
        return out / depth[:, None], depth
