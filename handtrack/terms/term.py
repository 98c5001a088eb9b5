"""Protocols of terms: costs that answer in bone twists, or in joint parameters."""

from __future__ import annotations

from typing import Protocol

from handtrack.arrays import Floats, S
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.terms.bone_system import BoneSystem, JointSystem
from handtrack.terms.term_table import TermTable


class ObservationTerm(Protocol):
    """A cost of bone poses. It never knows joints, couplings or the solver."""

    @property
    def name(self) -> str: ...

    def cost(self, bones: BonePoses) -> float:
        """Return ½ Σ r² (weighted, robust)."""
        ...

    def linearize(self, bones: BonePoses) -> BoneSystem:
        """Return cost, gradient and Gauss-Newton Hessian in bone twists about bones.reference."""
        ...

    def linearize_sized(self, bones: BonePoses, fields: BoneFields) -> JointSystem:
        """Return the same by N unknowns, of pose or shape: how they move and deform the bones is in `fields`."""
        ...


class TabledTerm(Protocol):
    """One that a compiled loop can sum by itself; found by its method, for asking a protocol takes longer than the sum."""

    def tables(self) -> list[TermTable] | None:
        """Return the term as tables for its kernels; None where it cannot be, as it is set up."""
        ...


class ParameterTerm(Protocol):
    """A cost of joint parameters: limits' softness, rest pose, continuity."""

    @property
    def name(self) -> str: ...

    def cost(self, joint_params: Floats[S]) -> float:
        """Return ½ Σ r² (weighted)."""
        ...

    def linearize(self, joint_params: Floats[S]) -> JointSystem:
        """Return cost, gradient and Hessian (S, S)."""
        ...
