"""Quadratic models of a cost: in bone twists (BoneSystem) and in parameters (JointSystem)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import B6, D3, B, Floats, K, P, S
from handtrack.terms.bone_kernels import pull_back_blocks


@dataclass(frozen=True)
class JointSystem:
    """cost + gᵀδ + ½ δᵀHδ for a change δ of K parameters, of joints or the solver's."""

    cost: float
    gradient: Floats[K]
    hessian: Floats[K, K]

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

    gradient: (6B,), hessian: (6B, 6B), six numbers a bone in the order of bones (Gauss-Newton). Where a person's size is
    fitted it is seven, (v, ω, σ): a bone may grow about the root too, dX = σ (X − o); docs/derivations/size.md.
    """

    cost: float
    gradient: Floats[B6]
    hessian: Floats[B6, B6]

    @classmethod
    def zero(cls, bone_count: int, width: int = 6) -> BoneSystem:
        """Return the system of no residual at all; width: 6, or 7 with growth."""
        n = width * bone_count
        return cls(0.0, np.zeros(n), np.zeros((n, n)))

    def __add__(self, other: BoneSystem) -> BoneSystem:
        return BoneSystem(
            self.cost + other.cost, self.gradient + other.gradient, self.hessian + other.hessian
        )

    def scaled(self, weight: float) -> BoneSystem:
        """Return the system of weight × cost."""
        return BoneSystem(weight * self.cost, weight * self.gradient, weight * self.hessian)

    def with_growth(self, moves_like: Floats[D3]) -> BoneSystem:
        """Return the system (7B) of residuals for which a bone that grows about the root by a share σ moves by σ · moves_like."""
        bones = len(self.gradient) // 6
        gradient, hessian = np.empty((bones, 7)), np.empty((bones, 7, bones, 7))
        gradient[:, :6] = self.gradient.reshape(bones, 6)
        gradient[:, 6] = gradient[:, :3] @ moves_like
        hessian[:, :6, :, :6] = self.hessian.reshape(bones, 6, bones, 6)
        mixed = hessian[:, :6, :, :3] @ moves_like
        hessian[:, :6, :, 6], hessian[:, 6, :, :6] = mixed, mixed.transpose(2, 0, 1)
        hessian[:, 6, :, 6] = np.einsum("i,bic->bc", moves_like, mixed[:, :3])
        return BoneSystem(self.cost, gradient.ravel(), hessian.reshape(7 * bones, 7 * bones))

    def pull_back(self, twist_jacobian: Floats[B, K, S]) -> JointSystem:
        """Return the system of joint parameters. twist_jacobian: (B, 6, S), or (B, 7, S) with growth."""
        if twist_jacobian.shape[1] == 7:
            dense = twist_jacobian.reshape(len(self.gradient), -1)
            return JointSystem(self.cost, self.gradient, self.hessian).pull_back(dense)
        return JointSystem(
            self.cost, *pull_back_blocks(self.gradient, self.hessian, twist_jacobian, False)
        )
