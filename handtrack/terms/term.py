"""Terms: costs that answer in motions of bones, or in joint parameters. docs/contributing/adding_a_term.md"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from handtrack.arrays import D3, Axes, B, Floats, Ints, K, L, N, P, S
from handtrack.errors import HandtrackError
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.terms.bone_kernels import pull_back


@dataclass(frozen=True)
class JointSystem:
    """cost + gᵀδ + ½ δᵀHδ for a change δ of K numbers: parameters of joints or the solver, or what moves bones."""

    cost: float
    gradient: Floats[K]
    hessian: Floats[K, K]

    @classmethod
    def zero(cls, count: int) -> JointSystem:
        """Return the system of no residual at all."""
        return cls(0.0, np.zeros(count), np.zeros((count, count)))

    def __add__(self, other: JointSystem) -> JointSystem:
        return JointSystem(
            self.cost + other.cost, self.gradient + other.gradient, self.hessian + other.hessian
        )

    def pull_back(self, matrix: Floats[K, P]) -> JointSystem:
        """Return the system of q where these numbers are matrix · q + offset."""
        return JointSystem(self.cost, matrix.T @ self.gradient, matrix.T @ self.hessian @ matrix)


class Sums(NamedTuple):
    """Gradient and Gauss-Newton Hessian to which terms add, in place; compiled code takes it as it is.

    width numbers for each bone: 6, its twist (v, ω), world axes, about the root; 12, where a person's shape is fitted, (v, G) as in
    `BoneFields`: bones turn and deform, dX = v + G (X − o), docs/explanation/trajectory.md. Of joint parameters there is one each.
    A width of 0 is of no use to anybody: the cost alone is wanted.
    """

    width: int
    gradient: Floats[N]
    hessian: Floats[N, N]

    @classmethod
    def zero(cls, count: int, width: int = 1) -> Sums:
        """Return sums of no residual yet, of `count` bones or joint parameters."""
        size = count * width
        return cls(width, np.zeros(size), np.zeros((size, size)))


COST_ALONE = Sums.zero(0, 0)


# ---- The kinds of terms


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


# ---- Residuals with their derivatives by the bones' motion, of terms that are written with NumPy


def motion_row(
    points: Floats[*Axes, D3], normals: Floats[*Axes, D3], reference: Floats[D3], width: int = 6
) -> Floats[*Axes, L]:
    """Return what the motion of X's bone adds to a measurement along n at X: [n ; (X − o) × n] by
    its twist, [n ; n (X − o)ᵀ] by its field, of twelve numbers; n alone by X's own velocity.

    Parameters
    ----------
    points, normals
        World, broadcast.
    """
    if width == 3:
        return normals
    arm = points - reference
    if width < 12:
        return np.concatenate([normals, np.cross(arm, normals)], axis=-1)
    outer = normals[..., None] * arm[..., None, :]
    return np.concatenate([normals, outer.reshape(*normals.shape[:-1], 9)], axis=-1)


def add_rows(
    sums: Sums, residual: Floats[N], bone: Ints[*Axes], motion: Floats[N, K, L], weight: Floats[N]
) -> None:
    """Add gradient Jᵀ W r and Hessian Jᵀ W J of residuals, each of which depends on K bones; nothing where derivatives are not wanted.

    Parameters
    ----------
    bone
        (K,) where they are the same for all residuals, else (N, K).
    motion
        Derivative of each residual by each of its bones' motion, see `motion_row`.
    weight
        dρ/d(r²).
    """
    if not sums.width:
        return
    count = len(residual)
    rows = np.zeros((count, len(sums.gradient) // sums.width, sums.width))
    np.add.at(rows, (np.arange(count)[:, None], bone), motion)
    rows = rows.reshape(count, -1)
    weighted = rows * weight[:, None]
    np.add(sums.gradient, weighted.T @ residual, out=sums.gradient)
    np.add(sums.hessian, weighted.T @ rows, out=sums.hessian)
