"""Keypoint terms: the model's joints, or pinned points of its bones, near points in space or in an image, robust."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, Array, Axes, Floats, Ints, J, K
from handtrack.errors import unknown_name
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.observation.observation import ImageKeypoints, Keypoints
from handtrack.observation.pins import ImagePins, Pin
from handtrack.terms.bone_system import BoneSystem, JointSystem
from handtrack.terms.keypoint_kernels import keypoint_kernel
from handtrack.terms.loss import Loss, Quadratic, compiled_loss
from handtrack.terms.rows import Rows, point_row
from handtrack.terms.term_table import TermTable

Observed = Keypoints | ImageKeypoints | ImagePins


def _known(model: ArticulatedModel, names: tuple[str, ...], seen: Array) -> Ints:
    where = f"the keypoints of {model.name}"
    joint = [_index(model.joint_names, name, "joint", where) for name in names]
    return np.array(joint, int)[seen]


@dataclass(frozen=True)
class KeypointTerm:
    """Distances of model joints to observed points, in units of the points' sigma.

    A point that is not known (NaN) has no row. The robust loss acts on a point's whole distance.
    """

    model: ArticulatedModel
    observed: Observed
    weight: float = 1.0
    loss: Loss = Quadratic()
    name: str = "keypoints"

    def rows(self, bones: BonePoses) -> Rows:
        """Return two (image) or three (space) rows a point."""
        bone, own, targets, sigma = self._places
        points = bones.to_world(bone, own)
        if isinstance(self.observed, Keypoints):
            difference = (points - targets) / sigma[:, None]
            directions = np.eye(3) / sigma[:, None, None]
        else:
            camera = self.observed.camera
            difference = (camera.project(points) - targets) / sigma[:, None]
            directions = camera.project_jacobian(points) / sigma[:, None, None]
        count, width = difference.shape
        squared = (difference**2).sum(axis=1)
        weight = self.weight * np.repeat(self.loss.weight(squared), width)
        twist = point_row(
            np.repeat(points, width, axis=0), directions.reshape(-1, 3), bones.reference
        )
        cost = 0.5 * self.weight * float(self.loss.value(squared).sum())
        row = np.arange(count * width)
        return Rows(difference.ravel(), row, np.repeat(bone, width), twist, cost, weight)

    @property
    def is_detected(self) -> bool:
        """Whether a detector saw the points, in an image."""
        return isinstance(self.observed, ImageKeypoints)

    @property
    def _places(self) -> tuple[Ints[K], Floats[K, D3], Floats[K, *Axes], Floats[K]]:
        """Bones, points in their frames [m], where they were seen, and each one's sigma, of what is known."""
        if isinstance(self.observed, ImagePins):
            return *pinned_places(self.model, self.observed.pins), *_targets(self.observed)
        targets, sigma = _targets(self.observed)
        joint = self._joints
        own, known = points_meant(self.model, self.observed)[joint], _are_known(targets)
        return self.model.joint_bone[joint], own, targets[known], sigma[known]

    @property
    def _joints(self) -> Ints[K]:
        """Which joints of the model were seen."""
        assert not isinstance(self.observed, ImagePins), "pins lie on bones"
        seen = _are_known(_targets(self.observed)[0])
        return _known(self.model, self.observed.names, seen)

    def misses(self, bones: BonePoses) -> tuple[Ints[K], Floats[K]]:
        """Return which joints of the model were seen, and how far from them they are, in units of the points' sigma."""
        off = self.rows(bones).residual.reshape(-1, _targets(self.observed)[0].shape[1])
        return self._joints, np.linalg.norm(off, axis=1)

    def cost(self, bones: BonePoses) -> float:
        return self.rows(bones).cost

    def linearize(self, bones: BonePoses) -> BoneSystem:
        return self.rows(bones).bone_system(len(bones.position))

    def linearize_sized(self, bones: BonePoses, fields: BoneFields) -> JointSystem:
        """Return cost, gradient and Hessian by N unknowns that move and deform the bones, or move what a detector sees."""
        rows, (bone, own, *_) = self.rows(bones), self._places
        arm = bones.to_world(bone, own) - bones.reference
        velocity, gradient = np.split(fields.joints[bone], [3], axis=1)
        moved = velocity + np.einsum(
            "kijn,kj->kin", gradient.reshape(-1, 3, 3, gradient.shape[2]), arm
        )
        if isinstance(self.observed, ImageKeypoints):
            scaled = fields.landmarks[self._joints]
            scaled = scaled if bones.growth is None else bones.growth[bone][:, :, None] * scaled
            moved += bones.rotation[bone] @ scaled
        along = rows.twist[:, :3].reshape(len(bone), -1, 3)
        derivative = (along @ moved).reshape(len(rows.residual), -1)
        weighted = derivative * rows.weight[:, None]
        return JointSystem(rows.cost, weighted.T @ rows.residual, weighted.T @ derivative)

    def tables(self) -> list[TermTable] | None:
        """Return one; None for a distorted camera."""
        bone, own, targets, sigma = self._places
        kind, scale = compiled_loss(self.loss, self.name)
        camera = np.zeros((0, 4))
        if not isinstance(self.observed, Keypoints):
            if self.observed.camera.is_distorted:
                return None
            camera = self.observed.camera.projection
        return [
            TermTable(
                keypoint_kernel, bone, own, targets, camera, sigma, np.array([kind, scale, self.weight], float),
            )
        ]  # fmt: skip


def points_meant(model: ArticulatedModel, observed: Keypoints | ImageKeypoints) -> Floats[J, D3]:
    """Return the points of the bones, in their frames [m], that observed joints mean: in images a detector's."""
    return model.seen_point if isinstance(observed, ImageKeypoints) else model.joint_point


def pinned_places(model: ArticulatedModel, pins: Sequence[Pin]) -> tuple[Ints[K], Floats[K, D3]]:
    """Return the bones, and the points in their frames [m], that are pinned. Raises HandtrackError for a place that the model
    has not.
    """
    where = f"a pin on {model.name}"
    names, bones, points = model.skeleton.bone_names, list[int](), list[Array]()
    for pin in pins:
        if pin.joint:
            joint = _index(model.joint_names, pin.joint, "joint", where)
            bones.append(int(model.joint_bone[joint]))
            points.append(model.joint_point[joint])
        else:
            bones.append(_index(names, pin.bone, "bone", where))
            points.append(np.array(pin.point, float))
    return np.array(bones, int), np.array(points).reshape(-1, 3)


def _index(names: Sequence[str], name: str, kind: str, where: str) -> int:
    if name not in names:
        raise unknown_name(kind, name, names, where)
    return list(names).index(name)


def _targets(observed: Observed) -> tuple[Floats, Floats]:
    """Return where points were seen, and each one's sigma."""
    if isinstance(observed, Keypoints):
        return observed.positions, np.full(len(observed.positions), observed.sigma_m)
    return observed.pixels, np.broadcast_to(observed.sigma_px, len(observed.pixels))


def _are_known(targets: Floats) -> Array[K]:
    return np.asarray(np.isfinite(targets).all(axis=1))
