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
    """½ weight Σ ρ((rows · x)² / (1 + (ratios · x)²)) on joint parameters (S,): combinations (R, S) that are near 0, in standard deviations.

    Serves for angles that go together without being coupled: neighbouring fingers, a finger's last two joints. ratios: how uncertain
    the coefficients of a combination are, in the same deviations: what is tied by an uncertain ratio is tied the less the more it bends.
    """

    rows: Floats[K, S]
    loss: Loss = Quadratic()
    weight: float = 1.0
    name: str = "posture"
    ratios: Floats[K, S] | None = None

    def cost(self, joint_params: Floats[S]) -> float:
        squared = self._residual(joint_params)[0] ** 2
        return 0.5 * self.weight * float(self.loss.value(squared).sum())

    def linearize(self, joint_params: Floats[S]) -> JointSystem:
        residual, slope = self._residual(joint_params)
        pull = self.weight * slope.T * self.loss.weight(residual**2)
        return JointSystem(self.cost(joint_params), pull @ residual, pull @ slope)

    def _residual(self, x: Floats[S]) -> tuple[Floats[K], Floats[K, S]]:
        """Return the combinations in standard deviations (K,), and their derivatives (K, S)."""
        ratios = np.zeros_like(self.rows) if self.ratios is None else self.ratios
        wide = np.sqrt(1.0 + (ratios @ x) ** 2)
        residual = self.rows @ x / wide
        return residual, self.rows / wide[:, None] - (residual * (ratios @ x) / wide**2)[
            :, None
        ] * ratios

    def tables(self) -> list[TermTable]:
        kind, scale = compiled_loss(self.loss, self.name)
        ratios = np.zeros_like(self.rows) if self.ratios is None else self.ratios
        return [TermTable(linear_kernel, self.rows, np.array([kind, scale, self.weight]), ratios)]


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
