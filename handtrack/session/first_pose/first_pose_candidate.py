"""A first pose that was found, how sure it is, and how it differs from others."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from handtrack.arrays import D3, Floats, J, P
from handtrack.geometry.rotation import rotation_matrix, turned_by
from handtrack.model.articulated import ArticulatedModel
from handtrack.session.first_pose.first_pose import FirstPose

_TURNED_DEG = 30.0  # less than that is not worth a word


@dataclass(frozen=True, eq=False)
class FirstPoseCandidate:
    """A pose that tracking may start from."""

    frame: int
    params: Floats[P]
    """solver parameters of `model`"""
    confidence: float
    """0 to 1; those of one frame add up to 1 at most"""
    note: str
    """in words: how it fits, or how it differs from the surest"""
    model: ArticulatedModel
    """a whole hand of the size in use, with a forearm where one is seen; or a body"""
    cost: float
    """comparable among the candidates of one frame"""
    given: FirstPose | None = None
    """points in space that the pose was fitted to, where there are any: they tell the hand's size as well"""
    p_in_basin: float = 1.0
    """how surely its joints are known to 12 mm, if it is the right one; a part of the confidence"""

    @property
    def settled(self) -> float:
        """How surely it is the right one of the poses that were found, however well it is known."""
        return self.confidence / self.p_in_basin

    @property
    def first_pose(self) -> FirstPose:
        """The pose as init.json holds it."""
        if self.given is not None:
            return replace(self.given, confidence=self.confidence)
        joint = self.model.joint_params(self.params)
        names = self.model.parameter_names
        values = dict(zip(names, joint.tolist(), strict=True))
        return FirstPose(self.frame, values, confidence=self.confidence)


def differs(best: FirstPoseCandidate, other: FirstPoseCandidate) -> str:
    """Return in words how far a pose is from the best, and how much worse it fits."""
    here, there = (_joints(c.model, c.params) for c in (best, other))
    away = 1e3 * float(np.linalg.norm(here - there, axis=1).mean())
    a, b = (rotation_matrix(c.model.joint_params(c.params)[3:6]) for c in (best, other))
    turned = np.rad2deg(float(turned_by(a, b)))
    parts = "limbs" if best.model.kind == "body" else "fingers"
    way = f"turned by {turned:.0f}°" if turned > _TURNED_DEG else f"{parts} bent otherwise"
    worse = other.cost / max(best.cost, 1e-12)
    return f"{way}, joints {away:.0f} mm away on average; fits {worse:.1f} times worse"


def _joints(model: ArticulatedModel, params: Floats[P]) -> Floats[J, D3]:
    """Return the joints by which poses are compared, world [m]: a hand with a forearm has more."""
    bones = model.bones(params)
    return model.keypoints21(bones) if model.has_keypoints21 else model.joint_positions(bones)
