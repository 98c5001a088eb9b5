"""KeypointProblem: keypoints, priors and limits as plain arrays, read by the compiled polishing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from handtrack.arrays import D2, D3, C, Floats, Ints, K, L, M, P, Q, S, contiguous
from handtrack.errors import index_of
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import KinematicTree
from handtrack.model.transform import MovingLimits
from handtrack.observation.observation import ImageKeypoints, Keypoints
from handtrack.terms.loss import Loss, quadratic
from handtrack.terms.priors import LinearPrior
from handtrack.terms.term import JointSystem, ParameterTerm


class KeypointProblem(NamedTuple):
    """Model, observations and priors; K points are looked at O times, by C cameras or in space."""

    tree: KinematicTree
    chains: tuple[Ints[L], Ints[Q]]
    """(B + 1,) where each bone's hinges begin in the other; the hinges that move each, from the root"""
    links: tuple[Ints[S], Ints[S], Floats[S]]
    """joint parameter = ratio · leader; each has one"""
    limits: MovingLimits
    points: tuple[Ints[K], Floats[K, D3]]
    """the bone of each, and where in its frame [m]"""
    views: tuple[Ints[L], Ints[M], Floats[M, D3], Floats[M]]
    """(K + 1,) where each point's observations begin; (O,) the camera of each, −1 for a point in space; (O, 3) pixels (third number
    unused) or world [m]; (O,) 1/σ²"""
    cameras: tuple[Floats[C, D3, D3], Floats[C, D3], Floats[C, D2], Floats[C, D2]]
    """R_camera_world, translation [m], focal lengths and middle [px]"""
    loss: Loss
    prior: tuple[Floats[P], float, Floats[P], Floats[P, P]]
    """where the priors were expanded, and their cost, gradient and Hessian there; they are quadratic, so this is exact everywhere"""


def keypoint_problem(
    model: ArticulatedModel,
    observed: Sequence[Keypoints | ImageKeypoints],
    priors: Sequence[ParameterTerm] = (),
    loss: Loss = quadratic(),
) -> KeypointProblem:
    """Return the arrays of a problem; its cost is that of `Problem` with a KeypointTerm for each of
    `observed`.

    Parameters
    ----------
    priors
        Quadratic ones (GaussianPrior, LinearPrior).

    Raises
    ------
    HandtrackError
        For unknown joints.
    """
    skeleton = model.skeleton
    chains = [skeleton.hinges_above(bone) for bone in range(skeleton.bone_count)]
    begin = np.concatenate([[0], np.cumsum([len(chain) for chain in chains])])
    prior = _expanded(model, priors)
    gradient, hessian = contiguous(prior.gradient, prior.hessian)
    return KeypointProblem(
        skeleton.tree,
        (begin.astype(np.int64), np.concatenate(chains).astype(np.int64)),
        model.transform.links,
        model.moving_limits,
        *_observations(model, observed),
        loss,
        (model.rest_params(), float(prior.cost), gradient, hessian),
    )


def _expanded(model: ArticulatedModel, priors: Sequence[ParameterTerm]) -> JointSystem:
    """Return the priors' sum as a system in solver parameters about the relaxed pose, ratios of angles taken as certain."""
    count = len(model.parameter_names)
    total = JointSystem(0.0, np.zeros(count), np.zeros((count, count)))
    at = model.joint_params(model.rest_params())
    for prior in priors:
        prior = replace(prior, ratios=None) if isinstance(prior, LinearPrior) else prior
        system = prior.linearize(at)
        assert np.allclose(system.hessian, prior.linearize(at + 0.5).hessian), (
            f"{prior.name}: only quadratic priors can be polished with"
        )
        total = total + system
    return total.pull_back(model.transform.matrix)


def _observations(
    model: ArticulatedModel, observed: Sequence[Keypoints | ImageKeypoints]
) -> tuple[Any, Any, Any]:
    """Return points, views and cameras, as a KeypointProblem has them."""
    rows: list[tuple[tuple[int, bool], int, Floats, float]] = []
    cameras = [seen.camera for seen in observed if isinstance(seen, ImageKeypoints)]
    for seen in observed:
        in_space = isinstance(seen, Keypoints)
        places = seen.positions if in_space else seen.pixels
        sigmas = np.full(len(places), seen.sigma_m) if in_space else np.asarray(seen.sigma_px)
        index = -1 if in_space else cameras.index(seen.camera)
        for name, place, sigma in zip(seen.names, places, sigmas, strict=True):
            joint = index_of("joint", name, model.joint_names, f"the keypoints of {model.name}")
            if np.isfinite(place).all():
                target = np.zeros(3)
                target[: len(place)] = place
                rows.append(((joint, in_space), index, target, 1.0 / float(sigma) ** 2))
    rows.sort(key=lambda row: (row[0], row[1]))
    meant = sorted({row[0] for row in rows})
    starts = np.cumsum([0, *(sum(row[0] == m for row in rows) for m in meant)])
    joints = [joint for joint, _ in meant]
    points = [
        (model.joint_point if given else model.observed_point)[joint] for joint, given in meant
    ]
    count = len(cameras)
    return (
        (
            np.asarray(model.joint_bone[joints], dtype=np.int64),
            np.array(points, dtype=float).reshape(-1, 3),
        ),
        (
            starts.astype(np.int64),
            np.array([row[1] for row in rows], dtype=np.int64),
            np.array([row[2] for row in rows], dtype=float).reshape(-1, 3),
            np.array([row[3] for row in rows], dtype=float),
        ),
        (
            np.array([c.rotation for c in cameras]).reshape(count, 3, 3),
            np.array([c.translation for c in cameras]).reshape(count, 3),
            np.array([np.diag(c.matrix)[:2] for c in cameras]).reshape(count, 2),
            np.array([c.matrix[:2, 2] for c in cameras]).reshape(count, 2),
        ),
    )
