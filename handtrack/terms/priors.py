"""Quadratic priors on joint parameters: a mean pose, linear combinations, a correlated Gaussian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats, K, S, contiguous
from handtrack.terms.loss import Loss, quadratic
from handtrack.terms.prior_kernels import correlated_sums, independent_sums, linear_sums
from handtrack.terms.term import ParameterTerm, Sums


@dataclass(frozen=True)
class GaussianPrior(ParameterTerm):
    """½ Σ ((x − mean)/sigma)² on joint parameters (S,); an infinite sigma leaves a parameter free.

    Serves as rest pose (mean = the relaxed hand) and as continuity (mean = the predicted pose).
    """

    mean: Floats[S]
    sigma: Floats[S]
    name: str = "prior"

    def add_to(self, joint_params: Floats[S], sums: Sums) -> float:
        x, mean, sigma = contiguous(joint_params, self.mean, self.sigma)
        return independent_sums(x, mean, sigma, sums)


@dataclass(frozen=True)
class LinearPrior(ParameterTerm):
    """½ weight Σ ρ((rows · x)² / (1 + (ratios · x)²)) on joint parameters (S,): combinations (R, S) that are near 0, in standard deviations.

    Serves for angles that go together without being coupled: neighbouring fingers, a finger's last two joints. ratios: how uncertain
    the coefficients of a combination are, in the same deviations: what is tied by an uncertain ratio is tied the less the more it bends.
    """

    rows: Floats[K, S]
    loss: Loss = quadratic()
    weight: float = 1.0
    name = "posture"
    ratios: Floats[K, S] | None = None

    def add_to(self, joint_params: Floats[S], sums: Sums) -> float:
        ratios = np.zeros_like(self.rows) if self.ratios is None else self.ratios
        x, rows, ratios = contiguous(joint_params, self.rows, ratios)
        return linear_sums(x, rows, ratios, self.loss, float(self.weight), sums)


@dataclass(frozen=True)
class CorrelatedPrior(ParameterTerm):
    """½ (x − mean)ᵀ information (x − mean) on joint parameters (S,): a normal distribution with correlations.

    Serves as continuity where it is known how well, and in which combinations, the last frame was seen.
    """

    mean: Floats[S]
    information: Floats[S, S]
    """symmetric, no negative direction"""
    name = "motion"

    def add_to(self, joint_params: Floats[S], sums: Sums) -> float:
        x, mean, information = contiguous(joint_params, self.mean, self.information)
        return correlated_sums(x, mean, information, sums)
