"""Quadratic priors on joint parameters: a mean pose, linear combinations, a correlated Gaussian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats, K, S
from handtrack.terms.bone_system import JointSystem
from handtrack.terms.loss import Loss, Quadratic, compiled_loss
from handtrack.terms.priors.prior_kernels import (
    correlated_kernel,
    independent_kernel,
    linear_kernel,
)
from handtrack.terms.term_table import TermTable


@dataclass(frozen=True)
class GaussianPrior:
    """½ Σ ((x − mean)/sigma)² on joint parameters (S,); an infinite sigma leaves a parameter free.

    Serves as rest pose (mean = the relaxed hand) and as continuity (mean = the predicted pose).
    """

    mean: Floats[S]
    sigma: Floats[S]
    name: str = "prior"

    def cost(self, joint_params: Floats[S]) -> float:
        return 0.5 * float((((joint_params - self.mean) / self.sigma) ** 2).sum())

    def linearize(self, joint_params: Floats[S]) -> JointSystem:
        information = 1.0 / self.sigma**2
        gradient = information * (joint_params - self.mean)
        return JointSystem(self.cost(joint_params), gradient, np.diag(information))

    def tables(self) -> list[TermTable]:
        return [TermTable(independent_kernel, self.mean, self.sigma)]


@dataclass(frozen=True)
class LinearPrior:
    """½ weight Σ ρ((rows · x)²) on joint parameters (S,): combinations (R, S) that are near 0, in standard deviations.

    Serves for angles that go together without being coupled: neighbouring fingers, a finger's last two joints.
    """

    rows: Floats[K, S]
    loss: Loss = Quadratic()
    weight: float = 1.0
    name: str = "posture"

    def cost(self, joint_params: Floats[S]) -> float:
        squared = (self.rows @ joint_params) ** 2
        return 0.5 * self.weight * float(self.loss.value(squared).sum())

    def linearize(self, joint_params: Floats[S]) -> JointSystem:
        residual = self.rows @ joint_params
        pull = self.weight * self.rows.T * self.loss.weight(residual**2)
        return JointSystem(self.cost(joint_params), pull @ residual, pull @ self.rows)

    def tables(self) -> list[TermTable]:
        kind, scale = compiled_loss(self.loss, self.name)
        return [TermTable(linear_kernel, self.rows, np.array([kind, scale, self.weight]))]


@dataclass(frozen=True)
class CorrelatedPrior:
    """½ (x − mean)ᵀ information (x − mean) on joint parameters (S,): a normal distribution with correlations.

    Serves as continuity where it is known how well, and in which combinations, the last frame was seen.
    """

    mean: Floats[S]
    information: Floats[S, S]
    """symmetric, no negative direction"""
    name: str = "motion"

    def cost(self, joint_params: Floats[S]) -> float:
        off = joint_params - self.mean
        return 0.5 * float(off @ self.information @ off)

    def linearize(self, joint_params: Floats[S]) -> JointSystem:
        gradient = self.information @ (joint_params - self.mean)
        return JointSystem(self.cost(joint_params), gradient, self.information)

    def tables(self) -> list[TermTable]:
        return [TermTable(correlated_kernel, self.mean, self.information)]
