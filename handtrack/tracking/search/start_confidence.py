"""How sure a first pose is: how well it fits, how much better than the next, and how well it is known if it is the one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import D3, Floats, J, N, P, indices
from handtrack.model.articulated import ArticulatedModel, keypoint_names
from handtrack.observation.observation import Observation
from handtrack.sampling.suppression import apart_joints
from handtrack.solver.covariance import joint_position_jacobian
from handtrack.solver.problem import Problem
from handtrack.terms.bone_kernels import pull_back
from handtrack.terms.silhouettes import outline_overlap
from handtrack.terms.term import Sums
from handtrack.tracking.frame.constants import (
    DOUBTFUL_CLOUD,
    DOUBTFUL_OVERLAP,
    LOST_CLOUD,
    LOST_OVERLAP,
)
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.cloud_terms import agreement
from handtrack.tracking.search.engine import Candidate

BASIN_M = 0.012
"""mean distance of the joints from their true places from which tracking goes on: what confidence is about"""
_BASIN_SHARE = 0.063
"""the same as a share of the length of a hand (190 mm), for bodies: 110 mm of 1.75 m"""
SIZE_SIGMA, KNOWN_SIZE_SIGMA = 0.06, 0.02
"""share by which adults' hands differ in size (ANSUR II: 5–95 % is ±10 %), and by which a measured one may be wrong"""
_DRAWS = 300  # of a pose from its spread
_DRAWN_OF_EACH = 64  # of each of several poses: 8 of them are known to 2 % together
_RIDGE = 1e-9  # of the largest diagonal entry: directions of which nothing is seen at all


def shares(costs: Floats[N], count: float) -> Floats[N]:
    """Return the share of each pose among all found, from their costs and how many errors are independent.

    How large errors usually are is not known for a first frame, so it is integrated out: with n independent
    measurements of unknown spread, a pose of cost E has the likelihood E^(−n/2).
    """
    least = max(float(costs.min()), 1e-12)
    weight = (np.maximum(costs, 1e-12) / least) ** (-0.5 * count)
    return weight / weight.sum()


def p_in_basin(
    problem: Problem, params: Floats[P], count: float, size_sigma: float, seed: int = 0
) -> float:
    """Return how surely a pose has its joints within 12 mm of the true ones on average, if it is the right one.

    Gaussian, about the problem's minimum, with the errors as large as what is left over there says; the hand's size, known
    to the share size_sigma, is one parameter more: seen by one camera, a larger hand stands further away.
    """
    model = problem.model
    bones, twist, joint = model.linearize(params)
    scale_change = np.zeros((*twist.shape[:2], 1))
    scale_change[:, :3, 0] = (
        bones.position - bones.reference
    )  # bones move apart, as thick as they were
    seen = Sums.zero(len(bones.position), 6)
    cost = sum(term.add_to(bones, seen) for term in problem.observation_terms)
    spread = max(2.0 * cost / count, 1.0)
    hessian = pull_back(seen, np.concatenate([twist, scale_change], axis=2))[1] / spread
    for prior in problem.parameter_terms:
        hessian[:-1, :-1] += prior.linearize(joint).hessian
    hessian[-1, -1] += size_sigma**-2
    matrix = np.zeros((len(hessian), len(params) + 1))
    matrix[:-1, :-1], matrix[-1, -1] = model.transform.matrix, 1.0
    hessian = matrix.T @ hessian @ matrix
    hessian += _RIDGE * np.diag(hessian).max() * np.eye(len(hessian))
    away = (model.joint_positions(bones) - bones.reference)[:, :, None]
    moves = np.concatenate([joint_position_jacobian(model, bones, twist), away], axis=2) @ matrix
    moves = moves[indices(model.joint_names, keypoint_names())]
    normal = np.random.default_rng(seed).normal(size=(len(hessian), _DRAWS))
    drawn = np.linalg.solve(np.linalg.cholesky(hessian).T, normal)
    off = np.linalg.norm(np.einsum("jip,pn->jin", moves, drawn), axis=1).mean(axis=0)
    return float(((off < BASIN_M).sum() + 1) / (_DRAWS + 2))  # Laplace's rule: never quite 0 or 1


def clustered_modes(found: Sequence[Candidate]) -> list[Candidate]:
    """Return the modes of a mixture of Gaussians, poses of one frame: the surest first, its confidence the share of all that lies near it.

    Near is what tracking goes on from: 12 mm of a hand, 110 mm of a body, on average over the joints, wherever the whole is: one
    camera does not tell how far away. Poses near a surer one are no mode of their own.

    Parameters
    ----------
    found
        of one model, each with its share of the mixture (`confidence`) and its normal matrix
    """
    rng, model = np.random.default_rng(0), found[0].model
    near = BASIN_M if model.kind == "hand" else _BASIN_SHARE * model_length(model)
    shape = np.array([_shape(model, c.params) for c in found])
    drawn, weight = [], np.repeat([c.confidence / _DRAWN_OF_EACH for c in found], _DRAWN_OF_EACH)
    for candidate in found:
        assert candidate.normal is not None
        values, axes = np.linalg.eigh(np.linalg.pinv(candidate.normal))
        steps = rng.normal(size=(_DRAWN_OF_EACH, len(values))) * np.sqrt(np.maximum(values, 0.0))
        drawn += [_shape(model, model.clipped(candidate.params + step)) for step in steps @ axes.T]
    away = np.linalg.norm(np.array(drawn)[:, None] - shape, axis=3).mean(axis=2)
    surest = np.argsort(-(weight @ (away < near)), kind="stable")
    kept = list(apart_joints(surest, shape, near))
    nearest = np.where(away[:, kept].min(axis=1) < near, away[:, kept].argmin(axis=1), -1)
    shares = [float(weight[nearest == n].sum()) for n in range(len(kept))]
    order = np.argsort(np.negative(shares), kind="stable").tolist()
    return [replace(found[kept[n]], confidence=shares[n]) for n in order]


def model_length(model: ArticulatedModel) -> float:
    """Return how far the joints of the model at rest lie apart at most [m]."""
    joints = model.joint_positions(model.bones(model.rest_params()))
    return float(np.linalg.norm(joints[:, None] - joints, axis=2).max())


def _shape(model: ArticulatedModel, params: Floats[P]) -> Floats[J, D3]:
    """Return the joints about their middle, world axes [m]."""
    joints = model.joint_positions(model.bones(params))
    return joints - joints.mean(axis=0)


def fit_quality(
    model: ArticulatedModel, settings: TrackerSettings, seen: Observation, params: Floats[P]
) -> float:
    """Return 0 to 1: 0 where tracking would call the pose lost, ½ where doubtful, 1 as far above that again."""
    bones = model.bones(params)
    terms = frame_terms(model, settings, seen, bones)
    qualities = []
    if terms.prepared:
        overlap = float(
            np.median(outline_overlap(terms.prepared, model.ellipsoids["fine"], bones).iou)
        )
        qualities.append(_between(overlap, LOST_OVERLAP, DOUBTFUL_OVERLAP))
    if terms.cloud is not None:
        share = agreement(terms.cloud, bones).explained
        qualities.append(_between(share, LOST_CLOUD, DOUBTFUL_CLOUD))
    return min(qualities, default=0.0)


def _between(value: float, lost: float, low: float) -> float:
    return float(np.clip(0.5 * (value - lost) / max(low - lost, 1e-9), 0.0, 1.0))
