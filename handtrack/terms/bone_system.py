"""Quadratic models of a cost: in bone twists (BoneSystem) and in parameters (JointSystem)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats
from handtrack.terms.bone_kernels import pull_back_blocks


@dataclass(frozen=True)
class JointSystem:
    """cost + gᵀδ + ½ δᵀHδ for a change δ of parameters (S,) or (P,)."""

    cost: float
    gradient: Floats
    hessian: Floats

    def __add__(self, other: JointSystem) -> JointSystem:
        return JointSystem(
            self.cost + other.cost, self.gradient + other.gradient, self.hessian + other.hessian
        )

    def pull_back(self, matrix: Floats) -> JointSystem:
        """Return the system of q where these parameters are matrix · q + offset. matrix: (S, P)."""
        return JointSystem(self.cost, matrix.T @ self.gradient, matrix.T @ self.hessian @ matrix)


@dataclass(frozen=True)
class BoneSystem:
    """cost + gᵀξ + ½ ξᵀHξ for twists ξ = (v, ω) of all bones, world axes, about the root.

    gradient: (6B,), hessian: (6B, 6B), six numbers a bone in the order of bones (Gauss-Newton).
    """

    cost: float
    gradient: Floats
    hessian: Floats

    @classmethod
    def zero(cls, bone_count: int) -> BoneSystem:
        """Return the system of no residual at all."""
        n = 6 * bone_count
        return cls(0.0, np.zeros(n), np.zeros((n, n)))

    def __add__(self, other: BoneSystem) -> BoneSystem:
        return BoneSystem(
            self.cost + other.cost, self.gradient + other.gradient, self.hessian + other.hessian
        )

    def scaled(self, weight: float) -> BoneSystem:
        """Return the system of weight × cost."""
        return BoneSystem(weight * self.cost, weight * self.gradient, weight * self.hessian)

    def pull_back(self, twist_jacobian: Floats) -> JointSystem:
        """Return the system of joint parameters. twist_jacobian: (B, 6, S)."""
        return JointSystem(
            self.cost, *pull_back_blocks(self.gradient, self.hessian, twist_jacobian)
        )
