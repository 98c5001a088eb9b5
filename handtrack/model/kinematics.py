"""Joint parameters → bone poses and twist Jacobians: the only place that differentiates joints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from handtrack.arrays import (
    D3,
    D4,
    D6,
    D12,
    Axes,
    B,
    Floats,
    Ints,
    J,
    K,
    N,
    S,
    array_dataclass,
    check_shape,
    contiguous,
)
from handtrack.errors import index_of
from handtrack.model.kinematics_kernels import linearize_pose, pose

# ---- The skeleton: bones and the freedoms of their joints, as plain data


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


# ---- Poses of the bones


class Frames(NamedTuple):
    """The bones' frames, as compiled sums take them."""

    rotation: Floats[B, D3, D3]
    position: Floats[B, D3]
    reference: Floats[D3]


@array_dataclass
class BonePoses:
    """Where every bone is, in the world."""

    reference: Floats[D3]
    """the point o that twists are taken about: the root's position [m]."""
    rotation: Floats[B, D3, D3]
    """bone frame → world."""
    position: Floats[B, D3]
    """proximal end of each bone, world [m]."""
    scale_change: Floats[B, D3] | None = None
    """scale factors of each bone, along its own axes about its proximal end, of all that is fixed to it; None: 1."""
    shift: Floats[B, D3] | None = None
    """of the ellipsoids on each bone, in its frame [m]; None: 0."""

    @property
    def frames(self) -> Frames:
        """The same for compiled sums; what bones have grown by is applied to points before."""
        return Frames(self.rotation, self.position, self.reference)

    @property
    def T_world_bone(self) -> Floats[B, D4, D4]:
        """Return transforms, bone → world."""
        transforms = np.zeros((len(self.position), 4, 4))
        transforms[:, :3, :3] = self.rotation
        transforms[:, :3, 3] = self.position
        transforms[:, 3, 3] = 1.0
        return transforms

    def to_world(self, bone: int | Ints[*Axes], points: Floats[*Axes, D3]) -> Floats[*Axes, D3]:
        """Return points of a bone's frame in the world [m]."""
        turned = np.einsum("...ij,...j->...i", self.rotation[bone], self.rescaled(bone, points))
        return self.position[bone] + turned

    def rescaled(self, bone: int | Ints[*Axes], points: Floats[*Axes, D3]) -> Floats[*Axes, D3]:
        """Return points of a bone's frame [m] where its growth has moved them, in that frame."""
        return points if self.scale_change is None else points * self.scale_change[bone]

    def rescaled_surface(self, bone: Ints[N], points: Floats[N, D3]) -> Floats[N, D3]:
        """Return points of bones' surfaces likewise: they shift with the ellipsoids, too."""
        return self.rescaled(bone, points) + (0.0 if self.shift is None else self.shift[bone])


@array_dataclass
class BoneFields:
    """How bones move and deform with each of N unknowns: a point X of one moves by v + G (X − o), world axes, about the poses'
    reference o; twelve numbers, (v, G row by row). G is antisymmetric where a bone only turns, symmetric where it only grows.
    """

    joints: Floats[B, D12, N]
    """of joints and landmarks"""
    surface: Floats[B, D12, N]
    """of what is on the bone's ellipsoids"""
    landmarks: Floats[J, D3, N]
    """how the points that a detector sees move besides, in their bones' frames, before these grow [m]"""
    outline: Floats[N]
    """by how much farther out outlines are in the images [m]"""

    @classmethod
    def of_twists(
        cls, twists: Floats[B, D6, N], landmarks: int, outline: Floats[N] | None = None
    ) -> BoneFields:
        """Return the fields of bones that move and turn.

        Parameters
        ----------
        landmarks
            How many points there are that a detector sees.
        outline
            As the field's, none unless given.
        """
        bones, _, count = twists.shape
        fields = np.zeros((bones, 12, count))
        fields[:, :3] = twists[:, :3]
        fields[:, [10, 5, 6]], fields[:, [8, 9, 4]] = twists[:, 3:], -twists[:, 3:]
        farther = np.zeros(count) if outline is None else outline
        return cls(fields, fields, np.zeros((landmarks, 3, count)), farther)

    def beside(self, other: BoneFields) -> BoneFields:
        """Return the fields of these unknowns, then those."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return BoneFields(*(np.concatenate(pair, axis=-1) for pair in pairs))


def bone_poses(skeleton: Skeleton, joint_params: Floats[S]) -> BonePoses:
    """Return the bones' poses for joint parameters [m, rad]. 2007 paper, eqs. 8–9 (at bone ends)."""
    params = _checked(skeleton, joint_params)
    rotation, position, _, _ = pose(skeleton.tree, params)
    return BonePoses(position[0], rotation, position, skeleton.scale_change, skeleton.shift)


def linearize(skeleton: Skeleton, joint_params: Floats[S]) -> tuple[BonePoses, Floats[B, D6, S]]:
    """Return the poses and the twist Jacobian: rows (v, ω), world axes, about the root.

    Column s of bone b is the twist of b per unit of parameter s: the same screw for every bone after
    the joint. Replaces eqs. 30–39 of the 2007 paper; docs/explanation/model.md.
    """
    rotation, position, jacobian = linearize_pose(skeleton.tree, _checked(skeleton, joint_params))
    return BonePoses(
        position[0], rotation, position, skeleton.scale_change, skeleton.shift
    ), jacobian


def _checked(skeleton: Skeleton, joint_params: Floats[S]) -> Floats[S]:
    params = np.ascontiguousarray(joint_params, dtype=float)
    check_shape(params, (skeleton.parameter_count,), "joint parameters")
    return params
