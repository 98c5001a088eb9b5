"""CompiledTerm: terms with a kernel, where one pass gives the cost and, if wanted, the derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod

from handtrack.arrays import Floats
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.terms.bone_system import BoneSystem, JointSystem


class CompiledTerm(ABC):
    """An ObservationTerm whose kernel adds to a gradient and a Hessian, or skips that work."""

    def cost(self, bones: BonePoses) -> float:
        """Return the weighted, robust cost, ½ Σ r² for a plain one."""
        nothing = BoneSystem.zero(0)
        return self._accumulate(bones, 0, nothing.gradient, nothing.hessian)

    def linearize(self, bones: BonePoses) -> BoneSystem:
        """Return cost, gradient and Gauss-Newton Hessian in bone twists about bones.reference."""
        return self._linearized(bones, 6)

    def linearize_sized(self, bones: BonePoses, fields: BoneFields) -> JointSystem:
        """Return the same by N unknowns that move and deform the flesh."""
        return self._linearized(bones, 12).pull_back(fields.flesh)

    def _linearized(self, bones: BonePoses, width: int) -> BoneSystem:
        system = BoneSystem.zero(len(bones.position), width)
        cost = self._accumulate(bones, width, system.gradient, system.hessian)
        return BoneSystem(cost, system.gradient, system.hessian)

    @abstractmethod
    def _accumulate(self, bones: BonePoses, width: int, gradient: Floats, hessian: Floats) -> float:
        """Return the cost and, with a width of 6 or 12, add to gradient (width · B,) and the Hessian; 0: the cost alone."""
