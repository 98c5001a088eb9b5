"""CompiledTerm: terms with a kernel, where one pass gives the cost and, if wanted, the derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod

from handtrack.arrays import Floats
from handtrack.model.kinematics import BonePoses
from handtrack.terms.bone_system import BoneSystem


class CompiledTerm(ABC):
    """An ObservationTerm whose kernel adds to a gradient and a Hessian, or skips that work."""

    def cost(self, bones: BonePoses) -> float:
        """Return the weighted, robust cost, ½ Σ r² for a plain one."""
        nothing = BoneSystem.zero(0)
        return self._accumulate(bones, False, nothing.gradient, nothing.hessian)

    def linearize(self, bones: BonePoses) -> BoneSystem:
        """Return cost, gradient and Gauss-Newton Hessian in bone twists about bones.reference."""
        system = BoneSystem.zero(len(bones.position))
        cost = self._accumulate(bones, True, system.gradient, system.hessian)
        return BoneSystem(cost, system.gradient, system.hessian)

    @abstractmethod
    def _accumulate(
        self, bones: BonePoses, want_system: bool, gradient: Floats, hessian: Floats
    ) -> float:
        """Return the cost and, if the system is wanted, add to gradient (6B,) and Hessian (6B, 6B)."""
