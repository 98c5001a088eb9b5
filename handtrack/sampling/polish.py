"""Bring many starts of one keypoint problem to their minima, compiled, in one thread."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import Array, Floats, N, P, array_dataclass, check_shape
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import ImageKeypoints, Keypoints
from handtrack.sampling.keypoint_problem import keypoint_problem
from handtrack.sampling.polish_kernels import polish_all
from handtrack.terms.loss import Loss, quadratic
from handtrack.terms.term import ParameterTerm


@array_dataclass
class Polished:
    """Where N polished starts ended, and whether in minima indeed."""

    params: Floats[N, P]
    """solver parameters, within limits"""
    cost: Floats[N]
    """infinite where a start led nowhere, as one behind a camera does"""
    normal: Floats[N, P, P]
    """Gauss-Newton matrix and priors; its inverse is the covariance"""

    has_converged: Array[N]
    """gradient below the tolerance"""
    hessian: Floats[N, P, P]
    """exact, with nothing but a large diagonal where a parameter is held"""

    @property
    def is_stable(self) -> Array[N]:
        """Whether the exact Hessian is positive definite on the free directions; scaled to unit Gauss-Newton diagonal, which changes no sign."""
        scale = np.sqrt(np.maximum(np.diagonal(self.normal, axis1=1, axis2=2), 1e-30))
        scaled = self.hessian / (scale[:, :, None] * scale[:, None, :])
        return np.linalg.eigvalsh(scaled)[:, 0] > 0.0

    @property
    def is_minimum(self) -> Array[N]:
        """Whether descent ended in a minimum: gradient below the tolerance, and positive Hessian on the free directions."""
        return self.has_converged & self.is_stable


def polish(
    model: ArticulatedModel,
    starts: Floats[N, P],
    observed: Sequence[Keypoints | ImageKeypoints],
    priors: Sequence[ParameterTerm] = (),
    loss: Loss = quadratic(),
    iterations: int = 200,
    tolerance: float = 1e-6,
) -> Polished:
    """Return the minima that descent reaches from starts, of the cost of KeypointTerms and priors.

    Starts outside the limits are first moved into them. Holds no lock while it runs; the same
    starts give the same bytes.

    Parameters
    ----------
    observed
        Joints in space or in any number of undistorted images.
    priors
        Quadratic ones.
    iterations
        Linearisations at most.
    tolerance
        Descent stops when the gradient on the free directions, each in its own standard deviations,
        is shorter.
    """
    problem = keypoint_problem(model, observed, priors, loss)
    params = np.array(starts, dtype=float, order="C")
    check_shape(params, (None, len(problem.prior[0])), "starts")
    cost, norm, normal, hessian = polish_all(problem, params, iterations, tolerance)
    converged = (norm < tolerance) & np.isfinite(cost)
    return Polished(params, cost, normal, converged, hessian)
