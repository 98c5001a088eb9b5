"""Covariance and unobservable directions of the solver parameters, from the normal matrix."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, D6, Array, B, Floats, J, K, P, S
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses

UNOBSERVABLE_STD = 1.0
"""[m, rad] a standard deviation beyond this says nothing: the direction counts as unobservable"""


def covariance(hessian: Floats[P, P]) -> tuple[Floats[P, P], Array[P, K]]:
    """Return H⁻¹ and the directions, unit vectors, that H does not determine.

    A direction is undetermined when its eigenvalue gives a standard deviation above UNOBSERVABLE_STD;
    its variance is capped there, so that the matrix stays finite.
    """
    values, vectors = np.linalg.eigh(0.5 * (hessian + hessian.T))
    least = 1.0 / UNOBSERVABLE_STD**2
    blind = values < least
    spread = 1.0 / np.maximum(values, least)
    return (vectors * spread) @ vectors.T, vectors[:, blind]


def inherited_information(motion: Floats[P, P], before: Floats[K, K] | None) -> Floats[P, P]:
    """Return what a prediction tells of a pose, an inverse covariance, when the pose before is not
    known exactly either.

    As in a Kalman filter, (M⁻¹ + C)⁻¹; written (I + M C)⁻¹ M, since M says nothing of parameters
    that move freely.

    Parameters
    ----------
    motion
        What it would tell otherwise: the inverse of how much a frame may change.
    before
        Covariance of the pose before; None where nothing is said of it.
    """
    if before is None or before.shape != motion.shape:  # that pose was another model's
        return motion
    found = np.linalg.solve(np.eye(len(motion)) + motion @ before, motion)
    return 0.5 * (found + found.T)


def with_lasting_errors(
    information: Floats[P, P], memory: Floats[P, P], points: Floats[P, P], lasting: float
) -> Floats[P, P]:
    """Return what is known of a pose where points err alike from frame to frame, an inverse
    covariance.

    A filter that takes such errors for new ones counts them twice; docs/explanation/solver.md.

    Parameters
    ----------
    information
        As if each frame's errors were its own.
    memory, points
        The prediction's and those points' parts of it.
    lasting
        Correlation of a point's errors in two frames that follow each other.
    """
    values, vectors = np.linalg.eigh(0.5 * (information + information.T))
    white = vectors / np.sqrt(np.maximum(values, 1e-12 * values[-1]))
    share, turn = np.linalg.eigh(white.T @ memory @ white)
    white, share = white @ turn, np.clip(share, 0.0, 1.0)
    gain = np.clip(np.einsum("pk,pq,qk->k", white, points, white), 0.0, 1.0)
    new = np.maximum(1.0 - share, gain).clip(1e-12)
    more = 2.0 * lasting * share * gain / ((1.0 - lasting * share) * (1.0 + share) * new)
    back = np.linalg.inv(white)
    return back.T @ (back / (1.0 + more)[:, None])


def uncertainty(
    model: ArticulatedModel,
    params: Floats[P],
    hessian: Floats[P, P],
    seen: Floats[P, P] | None = None,
) -> tuple[Floats[P, P], Floats[S], Floats[J, D3, D3]]:
    """Return the covariance of a pose's solver parameters, the standard deviations of its joint
    parameters [m, rad], infinite where unobservable, and the covariance of its joints' positions
    [m²].

    What only a prior holds counts as unobservable: its standard deviation is infinite, though its
    covariance is the prior's.

    Parameters
    ----------
    hessian
        Of the cost ½ Σ r².
    seen
        The observations' part of it, without priors.
    """
    cov, blind = covariance(hessian)
    if seen is not None:
        _, blind = covariance(seen)
    matrix = model.transform.matrix
    joint_cov = matrix @ cov @ matrix.T
    std = np.sqrt(np.maximum(np.diag(joint_cov), 0.0))
    std[(np.abs(matrix @ blind) > 0.5).any(axis=1)] = np.inf
    bones, jacobian, _ = model.linearize(params)
    moves = joint_position_jacobian(model, bones, jacobian) @ matrix
    return cov, std, moves @ cov @ np.swapaxes(moves, 1, 2)


def joint_position_jacobian(
    model: ArticulatedModel, bones: BonePoses, twist_jacobian: Floats[B, D6, S]
) -> Floats[J, D3, S]:
    """Return the velocity of each named joint per unit of each joint parameter."""
    arm = model.joint_positions(bones) - bones.reference
    twist = twist_jacobian[model.joint_bone]
    return twist[:, :3] + np.cross(twist[:, 3:], arm[:, :, None], axis=1)
