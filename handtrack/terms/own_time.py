"""Terms of what was seen a moment before or after a frame: the bones are carried there by their motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handtrack.arrays import D3, B, Floats, K, L, N, array_dataclass
from handtrack.geometry.rotation import skew
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.terms.term import ObservationTerm, Sums


@array_dataclass
class BoneMotion:
    """Where each bone goes from one moment to another: X → turn · X + shift, world axes [m]."""

    turn: Floats[B, D3, D3]
    shift: Floats[B, D3]

    @classmethod
    def between(cls, here: BonePoses, there: BonePoses) -> BoneMotion:
        """Return what carries the bones of one pose to another's."""
        turn = there.rotation @ np.swapaxes(here.rotation, 1, 2)
        return cls(turn, there.position - np.einsum("bij,bj->bi", turn, here.position))

    def carried(self, bones: BonePoses) -> BonePoses:
        """Return bones at the other moment."""
        position = np.einsum("bij,bj->bi", self.turn, bones.position) + self.shift
        rotation = self.turn @ bones.rotation
        return replace(bones, rotation=rotation, position=position)

    def by_here(self, reference: Floats[D3], width: int) -> Floats[B, K, K]:
        """Return what the motions of bones there are by those here, `width` numbers a bone as in `Sums`, both about one reference o:
        ω' = R ω and G' = R G Rᵀ, v' = R v + G' (o − R o − t).
        """
        count, turn = len(self.turn), self.turn
        arm = reference - turn @ reference - self.shift
        found = np.zeros((count, width, width))
        found[:, :3, :3] = turn
        if width == 6:
            found[:, 3:, 3:] = turn
            found[:, :3, 3:] = -skew(arm) @ turn
            return found
        assert width == 12, "of a person's shape, as terms of surfaces in space see it"
        fields = np.einsum("bik,bjl->bijkl", turn, turn).reshape(count, 3, 3, 9)
        found[:, 3:, 3:] = fields.reshape(count, 9, 9)
        found[:, :3, 3:] = np.einsum("bijm,bj->bim", fields, arm)
        return found


@array_dataclass
class AtOwnTime(ObservationTerm):
    """The cost of another term at the moment when its camera saw."""

    term: ObservationTerm
    motion_there: BoneMotion

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The term's own."""
        return self.term.name

    @property
    def is_detected(self) -> bool:
        """Whether it is of joints that a detector saw."""
        return self.term.is_detected

    def motion(self, bones: BonePoses, fields: BoneFields) -> Floats[B, L, N]:
        return self.term.motion(bones, fields)

    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        """Return the term's cost there; its derivatives are by the bones' motion here."""
        there, width = self.motion_there.carried(bones), sums.width
        if not width:
            return self.term.add_to(there, sums)
        count = len(bones.position)
        own, by = Sums.zero(count, width), self.motion_there.by_here(bones.reference, width)
        cost = self.term.add_to(there, own)
        sums.gradient[:] += np.einsum("bij,bi->bj", by, own.gradient.reshape(count, width)).ravel()
        rows = np.swapaxes(by, 1, 2) @ own.hessian.reshape(count, width, count * width)
        moved = np.swapaxes(rows.reshape(count * width, count, width), 0, 1) @ by
        sums.hessian[:] += np.swapaxes(moved, 0, 1).reshape(sums.hessian.shape)
        return cost
