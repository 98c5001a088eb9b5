"""KeypointProblem: keypoints, priors and limits as plain arrays, read by the compiled polishing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from handtrack.arrays import D2, D3, C, Floats, Ints, K, L, M, P, Q, S
from handtrack.errors import index_of
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.limits import MovingLimits
from handtrack.model.skeleton import KinematicTree
from handtrack.observation.observation import ImageKeypoints, Keypoints
from handtrack.terms.bone_system import JointSystem
from handtrack.terms.collision import Collisions, CollisionTerm
from handtrack.terms.loss import Loss, quadratic
from handtrack.terms.priors.priors import LinearPrior
from handtrack.terms.term import ParameterTerm


class KeypointProblem(NamedTuple):
    """Model, observations and priors; K points are looked at O times, by C cameras or in space."""

    tree: KinematicTree
    chain_start: Ints[Q]
    """(B + 1,) where each bone's hinges begin in `chain`"""
    chain: Ints[Q]
    """the hinges that move each bone, from the root"""
    links: tuple[Ints[S], Ints[S], Floats[S]]
    """joint parameter = ratio · leader; each has one"""
    limits: MovingLimits
    point_bone: Ints[K]
    point: Floats[K, D3]
    """in the bone's frame [m]"""
    view_start: Ints[L]
    """(K + 1,) where each point's observations begin"""
    camera: Ints[M]
    """(O,) index of a camera; −1 for a point in space"""
    target: Floats[M, D3]
    """(O, 3) pixels (third number unused) or world [m]"""
    information: Floats[M]
    """(O,) 1/σ²"""
    camera_rotation: Floats[C, D3, D3]
    """R_camera_world"""
    camera_translation: Floats[C, D3]
    camera_focal: Floats[C, D2]
    """[px]"""
    camera_middle: Floats[C, D2]
    """[px]"""
    overlaps: Collisions
    """parts that may not pass through each other"""
    loss: Loss
    prior_at: Floats[P]
    """where the priors were expanded; they are quadratic, so this is exact everywhere"""
    prior_cost: float
    prior_gradient: Floats[P]
    prior_hessian: Floats[P, P]


_NOTHING = Ellipsoids(np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)))


def keypoint_problem(
    model: ArticulatedModel,
    observed: Sequence[Keypoints | ImageKeypoints],
    priors: Sequence[ParameterTerm] = (),
    loss: Loss = quadratic(),
    collision: CollisionTerm | None = None,
) -> KeypointProblem:
    """Return the arrays of a problem; its cost is that of `Problem` with a KeypointTerm for each of
    `observed`.

    Parameters
    ----------
    priors
        Quadratic ones (GaussianPrior, LinearPrior).
    collision
        Parts that may not pass through each other.

    Raises
    ------
    HandtrackError
        For unknown joints.
    """
    skeleton = model.skeleton
    chain = [skeleton.hinges_above(bone) for bone in range(skeleton.bone_count)]
    prior = _expanded(model, priors)
    return KeypointProblem(
        tree=skeleton.tree,
        chain_start=np.concatenate([[0], np.cumsum([len(c) for c in chain])]).astype(np.int64),
        chain=np.concatenate(chain).astype(np.int64),
        links=model.transform.links,
        limits=model.moving_limits,
        **_observations(model, observed),
        overlaps=(collision or CollisionTerm(_NOTHING, np.zeros((0, 2), int))).collisions,
        loss=loss,
        prior_at=model.rest_params(),
        prior_cost=float(prior.cost),
        prior_gradient=np.ascontiguousarray(prior.gradient),
        prior_hessian=np.ascontiguousarray(prior.hessian),
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
) -> dict[str, Any]:
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
    return {
        "point_bone": np.asarray(model.joint_bone[joints], dtype=np.int64),
        "point": np.array(points, dtype=float).reshape(-1, 3),
        "view_start": starts.astype(np.int64),
        "camera": np.array([row[1] for row in rows], dtype=np.int64),
        "target": np.array([row[2] for row in rows], dtype=float).reshape(-1, 3),
        "information": np.array([row[3] for row in rows], dtype=float),
        "camera_rotation": np.array([c.rotation for c in cameras]).reshape(count, 3, 3),
        "camera_translation": np.array([c.translation for c in cameras]).reshape(count, 3),
        "camera_focal": np.array([np.diag(c.matrix)[:2] for c in cameras]).reshape(count, 2),
        "camera_middle": np.array([c.matrix[:2, 2] for c in cameras]).reshape(count, 2),
    }
