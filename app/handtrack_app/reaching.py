"""Reaching: bend one finger so that its tip meets a point, the rest of the hand held still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Keypoints
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.bone_system import JointSystem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.priors import GaussianPrior

_POINT_SIGMA_M = 0.001
_STAY_SIGMA = np.deg2rad(60.0)  # what the tip leaves open stays as it was
_SETTINGS = SolverSettings(iterations=12, damping=1e-3)


@dataclass(frozen=True)
class _OneFinger:
    """A problem in which only some solver parameters may move."""

    problem: Problem
    free: np.ndarray
    start: Floats

    def cost(self, params: Floats) -> float:
        return self.problem.cost(params)

    def linearize(self, params: Floats) -> JointSystem:
        return self.problem.linearize(params)

    def bounds(self, params: Floats) -> Floats:
        bounds = self.problem.bounds(params)
        bounds[~self.free] = self.start[~self.free, None]
        return bounds


def tip_names(model: ArticulatedModel) -> tuple[str, ...]:
    """Return the joints that can be pulled."""
    return tuple(name for name in model.joint_names if name.endswith("_tip"))


def reach(model: ArticulatedModel, params: Floats, tip: str, target: Floats) -> Floats:
    """Return params (P,) with one finger bent, within limits, so that its tip comes nearest to target (3,) [m]."""
    finger = tip.removesuffix("tip")
    free = np.array([name.startswith(finger) for name in model.transform.names])
    sigma = np.full(len(model.parameter_names), np.inf)
    sigma[6:] = _STAY_SIGMA
    pull = KeypointTerm(
        model, Keypoints((tip,), np.asarray(target, dtype=float)[None], _POINT_SIGMA_M)
    )
    stay = GaussianPrior(model.joint_params(params), sigma, "stay")
    return solve(_OneFinger(Problem(model, [pull], [stay]), free, params), params, _SETTINGS).params
