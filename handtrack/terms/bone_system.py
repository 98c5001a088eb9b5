"""Quadratic models of a cost: in bone twists (BoneSystem) and in parameters (JointSystem)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import B6, B, Floats, K, P, S
from handtrack.terms.bone_kernels import pull_back_blocks


@dataclass(frozen=True)
class JointSystem:
    """cost + gᵀδ + ½ δᵀHδ for a change δ of K parameters, of joints or the solver's."""

    cost: float
    gradient: Floats[K]
    hessian: Floats[K, K]

    @classmethod
    def zero(cls, count: int) -> JointSystem:
        """Return the system of no residual at all."""
        return cls(0.0, np.zeros(count), np.zeros((count, count)))

    def __add__(self, other: JointSystem) -> JointSystem:
        return JointSystem(
            self.cost + other.cost, self.gradient + other.gradient, self.hessian + other.hessian
        )

    def pull_back(self, matrix: Floats[S, P]) -> JointSystem:
        """Return the system of q where these parameters are matrix · q + offset."""
        return JointSystem(self.cost, matrix.T @ self.gradient, matrix.T @ self.hessian @ matrix)


@dataclass(frozen=True)
class BoneSystem:
    """cost + gᵀξ + ½ ξᵀHξ for twists ξ = (v, ω) of all bones, world axes, about the root.

    gradient: (6B,), hessian: (6B, 6B), six numbers a bone in the order of bones (Gauss-Newton). Where a person's shape is
    fitted it is twelve, (v, G) as in `BoneFields`: bones turn and deform, dX = v + G (X − o); docs/explanation/trajectory.md.
    """

    cost: float
    gradient: Floats[B6]
    hessian: Floats[B6, B6]

    @classmethod
    def zero(cls, bone_count: int, width: int = 6) -> BoneSystem:
        """Return the system of no residual at all; width: numbers a bone, 6 or 12."""
        n = width * bone_count
        return cls(0.0, np.zeros(n), np.zeros((n, n)))

    def __add__(self, other: BoneSystem) -> BoneSystem:
        return BoneSystem(
            self.cost + other.cost, self.gradient + other.gradient, self.hessian + other.hessian
        )

    def scaled(self, weight: float) -> BoneSystem:
        """Return the system of weight × cost."""
        return BoneSystem(weight * self.cost, weight * self.gradient, weight * self.hessian)

    def pull_back(self, jacobian: Floats[B, K, S]) -> JointSystem:
        """Return the system of S unknowns. jacobian: the twist Jacobian (B, 6, S), or fields (B, 12, S)."""
        if jacobian.shape[1] == 12:
            dense = jacobian.reshape(len(self.gradient), -1)
            return JointSystem(self.cost, self.gradient, self.hessian).pull_back(dense)
        return JointSystem(
            self.cost, *pull_back_blocks(self.gradient, self.hessian, jacobian, False)
        )
