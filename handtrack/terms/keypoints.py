"""Keypoint terms: the model's joints, or pinned points of its bones, near points in space or in an image, robust."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from handtrack.arrays import (
    D3,
    Array,
    Floats,
    Ints,
    J,
    K,
    L,
    N,
    array_dataclass,
    contiguous,
    indices,
)
from handtrack.errors import HandtrackError, check_name, index_of
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.observation.observation import ImageKeypoints, Keypoints
from handtrack.observation.pins import PIN_SIGMA_PX, ImagePins, Pin
from handtrack.terms.keypoint_kernels import keypoint_sums, point_velocities
from handtrack.terms.loss import Loss, quadratic
from handtrack.terms.term import ObservationTerm, Sums, add_rows, motion_row

Observed = Keypoints | ImageKeypoints | ImagePins


@lru_cache(maxsize=64)
def _joint_indices(joint_names: tuple[str, ...], names: tuple[str, ...], model: str) -> Ints[K]:
    """Return the indices of named joints among a model's. Raises HandtrackError for a name that is none."""
    where = f"the keypoints of {model}"
    return np.array([index_of("joint", name, joint_names, where) for name in names], int)


@dataclass(frozen=True)
class KeypointTerm(ObservationTerm):
    """Distances of model joints to observed points, in units of the points' sigma.

    A point that is not known (NaN) has no row. The robust loss acts on a point's whole distance.
    """

    model: ArticulatedModel
    observed: Observed
    weight: float = 1.0
    loss: Loss = quadratic()

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """`pins` for what a person said, else `keypoints`."""
        return "pins" if isinstance(self.observed, ImagePins) else "keypoints"

    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        bone, own, *seen = self._targets
        targets = bone, bones.rescaled(bone, own), *seen
        return keypoint_sums(bones.frames, targets, self.loss, float(self.weight), sums)

    def motion(self, bones: BonePoses, fields: BoneFields) -> Floats[K, D3, N]:
        """Return the velocity of each point: of what a detector means by a joint, besides the bone's own motion."""
        bone, own, *_ = self._targets
        joints = self._joints if self.is_detected else np.zeros(0, int)
        scale = np.ones_like(bones.position) if bones.scale_change is None else bones.scale_change
        return point_velocities(
            bones.frames,
            bone,
            bones.rescaled(bone, own),
            fields.joints,
            joints,
            scale,
            fields.landmarks,
        )

    @property
    def is_detected(self) -> bool:
        """Whether a detector saw the points, in an image."""
        return isinstance(self.observed, ImageKeypoints)

    @cached_property
    def _targets(self) -> tuple[Ints[K], Floats[K, D3], Floats, Floats[K], Floats]:
        """What is known of it, as `keypoint_sums` takes it: points on bones, and where they were observed."""
        observed = self.observed
        targets, sigma = _targets(observed)
        if isinstance(observed, ImagePins):
            bone, own = pinned_places(self.model, observed.pins)
        else:
            known, joint = _are_known(targets), self._joints
            meant = self.model.observed_point if self.is_detected else self.model.joint_point
            bone, own = self.model.joint_bone[joint], meant[joint]
            targets, sigma = targets[known], sigma[known]
        projection = (
            np.zeros((0, 4)) if isinstance(observed, Keypoints) else observed.camera.projection
        )
        own, targets, sigma, projection = contiguous(own, targets, sigma, projection)
        return np.ascontiguousarray(bone, np.int64), own, targets, sigma, projection

    @property
    def _joints(self) -> Ints[K]:
        """Which joints of the model were seen."""
        assert not isinstance(self.observed, ImagePins), "pins lie on bones"
        seen = _are_known(_targets(self.observed)[0])
        return _joint_indices(self.model.joint_names, self.observed.names, self.model.name)[seen]

    def residuals(self, bones: BonePoses) -> tuple[Ints[K], Floats[K, L]]:
        """Return which joints of the model were seen, and by what they are beside that, in units of the points' sigma, (K, 2) in an
        image or (K, 3).
        """
        bone, own, targets, sigma, _ = self._targets
        points = bones.to_world(bone, own)
        if not isinstance(self.observed, Keypoints):
            points = self.observed.camera.project(points)
        return self._joints, (points - targets) / sigma[:, None]

    def misses(self, bones: BonePoses) -> tuple[Ints[K], Floats[K]]:
        """Return which joints of the model were seen, and how far from them they are, in units of the points' sigma."""
        joints, off = self.residuals(bones)
        return joints, np.linalg.norm(off, axis=1)


def pinned_places(model: ArticulatedModel, pins: Sequence[Pin]) -> tuple[Ints[K], Floats[K, D3]]:
    """Return the bones, and the points in their frames [m], that are pinned. Raises HandtrackError for a place that the model
    has not.
    """
    where = f"a pin on {model.name}"
    bones, points = list[int](), list[Array]()
    for pin in pins:
        if pin.joint:
            joint = index_of("joint", pin.joint, model.joint_names, where)
            bones.append(int(model.joint_bone[joint]))
            points.append(model.joint_point[joint])
        else:
            bones.append(index_of("bone", pin.bone, model.skeleton.bone_names, where))
            points.append(np.array(pin.point, float))
    return np.array(bones, int), np.array(points).reshape(-1, 3)


def _targets(observed: Observed) -> tuple[Floats, Floats]:
    """Return where points were seen, and each one's sigma."""
    if isinstance(observed, Keypoints):
        return observed.positions, np.full(len(observed.positions), observed.sigma_m)
    sigma = PIN_SIGMA_PX if isinstance(observed, ImagePins) else observed.sigma_px
    return observed.pixels, np.full(len(observed.pixels), sigma)


def _are_known(targets: Floats) -> Array[K]:
    return np.asarray(np.isfinite(targets).all(axis=1))


# ---- A cost of one's own in one function: residuals of where some joints are


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
