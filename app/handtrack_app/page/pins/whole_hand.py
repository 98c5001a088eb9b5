"""The whole hand moved: parallel to a camera's image, or turned, its fingers as they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, D6, Floats
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack_app.protocol.snapshots import CameraCard

ROOT = ("root_tx", "root_ty", "root_tz", "root_rx", "root_ry", "root_rz")
_NEAR_AXIS_M = 0.004
"""so near to the axis the pointer tells no angle: a tremble would turn the hand over"""


def moved_root(
    root: Floats[D6], pivot: Floats[D3], turn: Floats[D3], move: Floats[D3]
) -> dict[str, float]:
    """Return root parameters by name [m, rad] after a turn about a point and a move.

    pivot: world [m], it stays where it is in the turn. turn: rotation vector, world [rad]. move: world [m].
    """
    rotation = rotation_matrix(turn)
    place = pivot + rotation @ (root[:3] - pivot) + move
    turned = rotation_vector(rotation @ rotation_matrix(root[3:6]))
    return dict(zip(ROOT, [*place.tolist(), *turned.tolist()], strict=True))


@dataclass(frozen=True, eq=False)
class WholeDrag:
    """A drag of the whole hand in a camera's picture, from where it began."""

    card: CameraCard
    root: Floats[D6]
    """[m, rad]"""
    middle: Floats[D3]
    """of the hand, world [m]"""
    start: Floats[D3]
    """what was taken hold of, world [m]"""
    turns: bool
    """about the line of sight to its middle; else it moves parallel to the image"""

    def to(self, end: Floats[D3]) -> dict[str, float] | None:
        """Return root parameters by name when the pointer is over a point, world [m]; None where that tells nothing."""
        place = self._as_deep(end, self.middle if self.turns else self.start)
        if place is None:
            return None
        none = np.zeros(3)
        if not self.turns:
            return moved_root(self.root, self.middle, none, place - self.start)
        axis = self.middle - self.card.centre
        axis = axis / np.linalg.norm(axis)
        before = self._as_deep(self.start, self.middle)
        if before is None:
            return None
        was, now = ((p - self.middle) - ((p - self.middle) @ axis) * axis for p in (before, place))
        if min(np.linalg.norm(was), np.linalg.norm(now)) < _NEAR_AXIS_M:
            return None
        angle = np.arctan2(np.cross(was, now) @ axis, was @ now)
        return moved_root(self.root, self.middle, axis * angle, none)

    def _as_deep(self, point: Floats[D3], other: Floats[D3]) -> Floats[D3] | None:
        """Return what the camera sees where it sees a point, as deep in its picture as another."""
        ahead, way = self.card.rotation[:, 2], point - self.card.centre
        depth = float((other - self.card.centre) @ ahead)
        along = float(way @ ahead)
        if depth <= 0 or along <= 1e-9 * float(np.linalg.norm(way)):
            return None
        return self.card.centre + way * (depth / along)
