"""What is known before looking: a pose that the hand is near. On joint parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats
from handtrack.terms.bone_system import JointSystem


@dataclass(frozen=True)
class GaussianPrior:
    """½ Σ ((x − mean)/sigma)² on joint parameters (S,); an infinite sigma leaves a parameter free.

    Serves as rest pose (mean = the relaxed hand), as continuity (mean = the predicted pose) and as a
    stiff start (small sigmas on the angles, so that the hand moves as one piece first).
    """

    mean: Floats
    sigma: Floats
    name: str = "prior"

    def cost(self, joint_params: Floats) -> float:
        return 0.5 * float((((joint_params - self.mean) / self.sigma) ** 2).sum())

    def linearize(self, joint_params: Floats) -> JointSystem:
        information = 1.0 / self.sigma**2
        gradient = information * (joint_params - self.mean)
        return JointSystem(self.cost(joint_params), gradient, np.diag(information))
