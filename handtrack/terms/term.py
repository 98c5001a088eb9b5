"""Terms: costs that answer in motions of bones, or in joint parameters. docs/contributing/adding_a_term.md"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from handtrack.arrays import B, Floats, L, N, S
from handtrack.errors import HandtrackError
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.terms.bone_kernels import pull_back
from handtrack.terms.bone_system import COST_ALONE, JointSystem, Sums


def check_noise(name: str, sigma_m: float, slack_m: float = 0.0) -> None:
    """Raise HandtrackError unless a term's σ is a positive length, and what is free of cost none below 0 [m]."""
    if not (0.0 < sigma_m < np.inf and slack_m >= 0.0):
        raise HandtrackError(
            f"{name}: sigma {sigma_m:g} m and slack {slack_m:g} m; expected positive lengths."
        )


class ObservationTerm(ABC):
    """A cost of bone poses. It never knows joints, couplings or the solver."""

    name: str

    @property
    def is_detected(self) -> bool:
        """Whether it is of joints that a detector saw, which may be others."""
        return False

    @abstractmethod
    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        """Return the cost, ½ Σ r² for a plain one, and add its derivatives to `sums` unless their width is 0."""

    def motion(self, bones: BonePoses, fields: BoneFields) -> Floats[B, L, N]:
        """Return how the term's points move by N unknowns, as many numbers a bone as its sums then have."""
        return fields.joints

    def cost(self, bones: BonePoses) -> float:
        """Return the weighted, robust cost."""
        return self.add_to(bones, COST_ALONE)

    def linearize(self, bones: BonePoses, fields: BoneFields | None = None) -> JointSystem:
        """Return cost, gradient and Gauss-Newton Hessian in bone twists about bones.reference.

        Parameters
        ----------
        fields
            How N unknowns, of pose or shape, move and deform the bones; then the system is theirs.
        """
        if fields is None:
            sums = Sums.zero(len(bones.position), 6)
            cost = self.add_to(bones, sums)
            return JointSystem(cost, sums.gradient, sums.hessian)
        motion = self.motion(bones, fields)
        sums = Sums.zero(*motion.shape[:2])
        return JointSystem(self.add_to(bones, sums), *pull_back(sums, motion))


class SurfaceTerm(ObservationTerm):
    """One of points on the ellipsoids that are fixed to bones."""

    def motion(self, bones: BonePoses, fields: BoneFields) -> Floats[B, L, N]:
        return fields.surface


class ParameterTerm(ABC):
    """A cost of joint parameters: limits' softness, rest pose, continuity."""

    name: str

    @abstractmethod
    def add_to(self, joint_params: Floats[S], sums: Sums) -> float:
        """Return the cost and add its derivatives to `sums` unless their width is 0."""

    def cost(self, joint_params: Floats[S]) -> float:
        """Return ½ Σ r² (weighted)."""
        return self.add_to(joint_params, COST_ALONE)

    def linearize(self, joint_params: Floats[S]) -> JointSystem:
        """Return cost, gradient and Hessian (S, S)."""
        sums = Sums.zero(len(joint_params))
        return JointSystem(self.add_to(joint_params, sums), sums.gradient, sums.hessian)
