"""Inverse kinematics of a drag: bend one finger, arm or leg so that a place of it meets a point, the rest held still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handtrack.arrays import D3, Array, Floats, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Keypoints
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.priors import GaussianPrior

_POINT_SIGMA_M = 0.001
_STAY_SIGMA = np.deg2rad(60.0)  # what the place leaves open stays as it was
_SETTINGS = SolverSettings(iterations=12, damping=1e-3)
_HELD = "held"


def limb(model: ArticulatedModel, bone: int) -> set[int]:
    """Return the bones of the finger, arm or leg that a bone is of: up to where another branches off, and to its end. Empty for
    a bone that no joint of its own limb moves: a palm's, a trunk's.
    """
    parent = model.skeleton.parent.tolist()
    children = [[b for b, p in enumerate(parent) if p == own] for own in range(len(parent))]
    above = list[int]()
    while bone >= 0 and len(children[bone]) <= 1:
        above.append(bone)
        bone = parent[bone]
    if not set(above) & set(model.skeleton.hinge_bone.tolist()):
        return set()
    below = above[:1]
    while len(children[below[-1]]) == 1:
        below += children[below[-1]]
    return {*above, *below}


def stem_bones(model: ArticulatedModel) -> tuple[str, ...]:
    """Return the bones at which a pull moves the whole model: they are of no limb."""
    names = model.skeleton.bone_names
    return tuple(name for bone, name in enumerate(names) if not limb(model, bone))


def _free(model: ArticulatedModel, bone: int) -> Array[P]:
    """Return True for the solver parameters that a pull at a bone changes: those of its limb, or the root's place."""
    own, moved = np.zeros(len(model.parameter_names), bool), limb(model, bone)
    own[6:] = [hinge in moved for hinge in model.skeleton.hinge_bone.tolist()]
    own[:3] = not moved
    drives = model.transform.matrix != 0
    return drives[own].any(axis=0) & ~drives[~own].any(axis=0)


def reach(
    model: ArticulatedModel,
    params: Floats[P],
    bone: int,
    point: Floats[D3],
    target: Floats[D3],
) -> Floats[P]:
    """Return params with one limb bent, within limits, so that a place of it comes nearest to target, world [m]; of what is of no
    limb, the whole moves. point: in the bone's frame [m].
    """
    sigma = np.full(len(model.parameter_names), np.inf)
    sigma[6:] = _STAY_SIGMA
    held = replace(
        model,
        joint_names=(*model.joint_names, _HELD),
        joint_bone=np.append(model.joint_bone, bone),
        joint_point=np.vstack([model.joint_point, point]),
        offset=None,
    )
    meant = Keypoints((_HELD,), np.asarray(target, dtype=float)[None], _POINT_SIGMA_M)
    stay = GaussianPrior(model.joint_params(params), sigma, "stay")
    problem = Problem(model, [KeypointTerm(held, meant)], [stay])
    free = _free(model, bone)
    return solve(problem, params, _SETTINGS, limits=problem.limits.frozen(~free, params)).params
