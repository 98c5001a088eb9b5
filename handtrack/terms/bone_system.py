"""What terms add up to: a quadratic model of the cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from handtrack.arrays import Floats, K, N, P


@dataclass(frozen=True)
class JointSystem:
    """cost + gᵀδ + ½ δᵀHδ for a change δ of K numbers: parameters of joints or the solver, or what moves bones."""

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

    def pull_back(self, matrix: Floats[K, P]) -> JointSystem:
        """Return the system of q where these numbers are matrix · q + offset."""
        return JointSystem(self.cost, matrix.T @ self.gradient, matrix.T @ self.hessian @ matrix)


class Sums(NamedTuple):
    """Gradient and Gauss-Newton Hessian to which terms add, in place; compiled code takes it as it is.

    width numbers for each bone: 6, its twist (v, ω), world axes, about the root; 12, where a person's shape is fitted, (v, G) as in
    `BoneFields`: bones turn and deform, dX = v + G (X − o), docs/explanation/trajectory.md. Of joint parameters there is one each.
    A width of 0 is of no use to anybody: the cost alone is wanted.
    """

    width: int
    gradient: Floats[N]
    hessian: Floats[N, N]

    @classmethod
    def zero(cls, count: int, width: int = 1) -> Sums:
        """Return sums of no residual yet, of `count` bones or joint parameters."""
        size = count * width
        return cls(width, np.zeros(size), np.zeros((size, size)))


COST_ALONE = Sums.zero(0, 0)
