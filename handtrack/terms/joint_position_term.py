"""A cost of one's own in one function: residuals of where some joints are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from handtrack.arrays import D3, Floats, Ints, J, N, array_dataclass, indices
from handtrack.errors import HandtrackError, check_name
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.terms.bone_system import Sums
from handtrack.terms.rows import add_rows, motion_row
from handtrack.terms.term import ObservationTerm

_STEP_M = 1e-6
"""of central differences: their error, the step's square, and that of rounding, 1e-16 over it, are both below 1e-9"""


@array_dataclass
class JointPositionTerm(ObservationTerm):
    """½ Σ r², for residuals r of the positions of some joints.

    residuals: is given positions (J, 3), world [m], of the joints in the order of `joints`, and returns numbers (N,), each 1
    where it is off by a standard deviation; always as many. It is differentiated by central differences. Raises
    HandtrackError for a joint that the model does not have, and residuals that are not finite numbers.
    """

    model: ArticulatedModel
    joints: Sequence[str]
    residuals: Callable[[Floats[J, D3]], Floats[N]]
    name: str = "own"

    def __post_init__(self) -> None:
        for joint in self.joints:
            check_name("joint", joint, self.model.joint_names)

    @cached_property
    def _places(self) -> tuple[Ints[J], Floats[J, D3]]:
        """The bone of each joint, and where in its frame the joint is."""
        rows = indices(self.model.joint_names, self.joints)
        return self.model.joint_bone[rows], self.model.joint_point[rows]

    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        bone, _ = self._places
        points = bones.to_world(*self._places)
        residual = self._residual(points)
        if sums.width:
            slopes = self._slopes(points, len(residual))
            motion = motion_row(points, slopes, bones.reference, sums.width)
            add_rows(sums, residual, bone, motion, np.ones(len(residual)))
        return 0.5 * float(residual @ residual)

    def _slopes(self, points: Floats[J, D3], count: int) -> Floats:
        """Return each residual's derivative by each joint's place (N, J, 3) [1/m]."""
        slopes = np.empty((count, len(points), 3))
        for joint in range(len(points)):
            for axis in range(3):
                ahead, behind = points.copy(), points.copy()
                ahead[joint, axis] += _STEP_M
                behind[joint, axis] -= _STEP_M
                change = self._residual(ahead) - self._residual(behind)
                slopes[:, joint, axis] = change / (2 * _STEP_M)
        return slopes

    def _residual(self, points: Floats[J, D3]) -> Floats[N]:
        residual = np.asarray(self.residuals(points), dtype=float).ravel()
        if not np.isfinite(residual).all():
            raise HandtrackError(
                f"term '{self.name}': its residuals have values that are not finite numbers, at joints {list(self.joints)}. "
                "Return 0 where nothing is known."
            )
        return residual
