"""Skeleton: bones in a tree and the freedoms of their joints, as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from handtrack.arrays import D3, B, Floats, Ints, K, contiguous
from handtrack.errors import index_of

KinematicTree = tuple[Ints[B], Floats[B, D3], Floats[B, D3, D3], Ints[K], Floats[K, D3]]
ROOT_PARAMETERS = ("root_tx", "root_ty", "root_tz", "root_rx", "root_ry", "root_rz")


@dataclass(frozen=True)
class Skeleton:
    """Bones (parents come first) and the hinges that move them.

    The root turns and moves freely in the world by the first six parameters; every other freedom is a
    hinge at the proximal end of its bone. A bone's frame has its origin there and +y along the bone.
    """

    bone_names: tuple[str, ...]
    parent: Ints[B]
    """index of each bone's parent; −1 for the root, which is bone 0."""
    offset: Floats[B, D3]
    """proximal end in the parent's frame [m]; zero for the root."""
    rest_rotation: Floats[B, D3, D3]
    """bone frame → parent's frame when all freedoms are zero."""
    length: Floats[B]
    """[m]"""
    parameter_names: tuple[str, ...]
    """(S,) the six of the root, then the hinges, sorted by bone; within a bone the first hinge turns first."""
    hinge_bone: Ints[K]
    """(S − 6,) the bone that each hinge moves."""
    hinge_axis: Floats[K, D3]
    """(S − 6, 3) unit axis in the bone's rest frame."""
    scale_change: Floats[B, D3] | None = None
    """as of `BonePoses`: of a person whose shape is being fitted."""
    shift: Floats[B, D3] | None = None
    """the same"""

    @cached_property
    def tree(self) -> KinematicTree:
        """The same for compiled code: parents, offsets, rest rotations, hinges' bones and axes."""
        offset, rest, axis = contiguous(self.offset, self.rest_rotation, self.hinge_axis)
        hinges = np.asarray(self.hinge_bone, np.int64)
        return np.asarray(self.parent, np.int64), offset, rest, hinges, axis

    @property
    def bone_count(self) -> int:
        return len(self.bone_names)

    @property
    def parameter_count(self) -> int:
        return len(self.parameter_names)

    def ancestors(self, bone: int) -> list[int]:
        """Return a bone, and those that it hangs on."""
        path = [bone]
        while self.parent[path[-1]] >= 0:
            path.append(int(self.parent[path[-1]]))
        return path

    def hinges_above(self, bone: int) -> Ints[K]:
        """Return the hinges that move a bone, in the order of joint parameters: ancestors first."""
        return np.flatnonzero(np.isin(self.hinge_bone, self.ancestors(bone)))

    def bone(self, name: str) -> int:
        """Return the index of a bone; HandtrackError names the known ones."""
        return index_of("bone", name, self.bone_names)

    def parameter(self, name: str) -> int:
        """Return the index of a joint parameter; HandtrackError names the known ones."""
        return index_of("parameter", name, self.parameter_names)
