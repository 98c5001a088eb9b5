"""Inverse kinematics of a drag: bend one finger, arm or leg so that its end meets a point, the rest held still."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, Floats, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Keypoints
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import FreeProblem, Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.priors.priors import GaussianPrior

_POINT_SIGMA_M = 0.001
_STAY_SIGMA = np.deg2rad(60.0)  # what the tip leaves open stays as it was
_SETTINGS = SolverSettings(iterations=12, damping=1e-3)


def _limb(model: ArticulatedModel, tip: str) -> np.ndarray:
    """Return (P,) True for solver parameters that move this end and no other: a finger, an arm, a leg."""
    ends = {name: _bones_before(model, name) for name in tip_names(model)}
    others = set().union(*(bones for name, bones in ends.items() if name != tip))
    hinges = [bone in ends[tip] and bone not in others for bone in model.skeleton.hinge_bone]
    own = np.concatenate([np.zeros(6, bool), np.array(hinges, bool)])
    drives = model.transform.matrix != 0
    return drives[own].any(axis=0) & ~drives[~own].any(axis=0)


def _bones_before(model: ArticulatedModel, joint: str) -> set[int]:
    bone, bones = int(model.joint_bone[model.joint_names.index(joint)]), set()
    while bone >= 0:
        bones.add(bone)
        bone = int(model.skeleton.parent[bone])
    return bones


def tip_names(model: ArticulatedModel) -> tuple[str, ...]:
    """Return the joints that can be pulled: fingertips; of a body wrists and ankles."""
    ends = ("_wrist", "_ankle") if model.kind == "body" else ("_tip",)
    return tuple(name for name in model.joint_names if name.endswith(ends))


def reach(model: ArticulatedModel, params: Floats[P], tip: str, target: Floats[D3]) -> Floats[P]:
    """Return params with one limb bent, within limits, so that its end comes nearest to target [m]."""
    free = _limb(model, tip)
    sigma = np.full(len(model.parameter_names), np.inf)
    sigma[6:] = _STAY_SIGMA
    pull = KeypointTerm(
        model, Keypoints((tip,), np.asarray(target, dtype=float)[None], _POINT_SIGMA_M)
    )
    stay = GaussianPrior(model.joint_params(params), sigma, "stay")
    return solve(
        FreeProblem(Problem(model, [pull], [stay]), free, params), params, _SETTINGS
    ).params
