"""Small changes of the cameras, the same in all frames: how each sees the hand, and what is known of them beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from handtrack.arrays import D6, D8, Array, C, F, Floats, K, P
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import left_jacobian, rotation_matrix, skew
from handtrack.terms.bone_system import JointSystem
from handtrack.tracking.size.motion import PLACE, TURN, changes, moved

_TURN_RAD, _SHIFT_M, _ZOOM = np.deg2rad(0.5), 0.002, 0.005
"""what a calibration may be off by: a camera that was touched after it, or a board that was not flat. Of turn and shift the length"""
_LATE_FRAMES = 0.3
"""frames of equal number are of one moment, as cameras with a common trigger see them; one that dropped frames may be late by any
number: a Cauchy bell, under which one camera that is two frames late costs less than three that share it. With 0.1, 0.17 and 0.38 of half
a frame were found of two real cameras, and 0.1 of a frame and a half of a slow hand"""
_COMMON_ZOOM = 1e-5
"""what all cameras are zoomed by together is the hand's size, or masks that are all too wide, and no camera's: held at nothing"""
_SIGMA = np.array([_TURN_RAD / 3**0.5] * 3 + [_SHIFT_M / 3**0.5] * 3 + [_ZOOM])
_OTHER_FRAME = 0.75
"""frames by which a camera must be late before its next image is nearer for sure: half a frame, and a margin against going to
and fro"""
TURNED, SHIFTED, ZOOMED, LATE = slice(0, 3), slice(3, 6), 6, 7
ALL, TIME, NOTHING = np.ones(8, bool), np.arange(8) == LATE, np.zeros(8, bool)
"""which of a camera's numbers are found: all, when it saw, none"""


@dataclass(frozen=True, eq=False)
class SeenPoses:
    """The hand of all frames as one camera sees it."""

    poses: Floats[F, P]
    """solver parameters at which the camera's terms are evaluated"""
    by_pose: Floats[F, D6, D6]
    """by how much place and turn there change with those of the poses; all else is the same"""
    by_camera: Floats[F, P, D8]
    """by how much they change with the camera; changes as `motion.moved` makes them"""


@dataclass(frozen=True, eq=False)
class CameraChanges:
    """Eight numbers a camera: turn [rad] and shift [m] in world axes about its centre, zoom (a share), and how late it is [frames].

    A camera that is turned and shifted sees what it would see, were the hand moved the opposite way. These are the hand's: of the
    camera they are the opposite (`corrected`). A longer focal length is a hand that is nearer by the same share of its depth:
    true to that share of the hand's own depth, a tenth. A camera that is late shows the hand of earlier: `late` is negative where
    its image shows what came before.
    """

    cameras: tuple[Camera, ...]
    """as they were calibrated"""
    values: Floats[C, D8]
    ahead: tuple[int, ...]
    """which of a camera's images is looked at beside a frame, in frames after it: what is late by whole frames"""

    free: Array[D8] = field(default_factory=ALL.copy)
    """which are found; the others stay as they are"""
    expected: Floats[C] | float = 0.0
    """[frames] by which the cameras are later as far as is known beforehand"""

    @classmethod
    def none(
        cls, cameras: Sequence[Camera] = (), apart: Mapping[str, float] | None = None
    ) -> CameraChanges:
        """Return cameras as they were calibrated; apart: by name, how many frames later they are, as is known."""
        expected = np.array([(apart or {}).get(camera.name, 0.0) for camera in cameras])
        values = np.zeros((len(cameras), 8))
        values[:, LATE] = expected
        return cls(tuple(cameras), values, (0,) * len(cameras), expected=expected)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(camera.name for camera in self.cameras)

    @property
    def count(self) -> int:
        """How many numbers there are to find."""
        return len(self.cameras) * int(self.free.sum())

    def finding(self, free: Array[D8]) -> CameraChanges:
        """Return the same, of which other numbers are found from now on."""
        return replace(self, free=free)

    def stepped(self, step: Floats[K]) -> CameraChanges:
        """Return the changes after a step of all numbers."""
        values = self.values.copy()
        values[:, self.free] += step.reshape(len(values), int(self.free.sum()))
        return replace(self, values=values)

    def prior(self, weight: float = 1.0, time_weight: float = 1.0) -> JointSystem:
        """Return what is known of them before anything is seen, by the free numbers (K,), of time weighing otherwise."""
        plain, late = self.values[:, :LATE] / _SIGMA, self.late
        told = 1.0 / (_LATE_FRAMES**2 + late**2)
        cost = 0.5 * weight * (plain**2).sum()
        by_time = 0.5 * np.log1p((late / _LATE_FRAMES) ** 2).sum()
        gradient = np.column_stack([plain / _SIGMA, late * told])
        hessian = np.diag(np.column_stack([np.tile(_SIGMA**-2, (len(plain), 1)), told]).ravel())
        zoomed, count = (
            float(self.values[:, ZOOMED].mean()) if len(told) else 0.0,
            max(len(told), 1),
        )
        gradient[:, ZOOMED] += zoomed / (count * _COMMON_ZOOM**2)
        hessian[ZOOMED::8, ZOOMED::8] += 1.0 / (count * _COMMON_ZOOM) ** 2
        cost += 0.5 * weight * (zoomed / _COMMON_ZOOM) ** 2
        by = np.tile(np.where(TIME, time_weight, weight), len(told))
        at = np.flatnonzero(np.tile(self.free, len(told)))
        found = JointSystem(
            float(cost + time_weight * by_time), by * gradient.ravel(), by * hessian
        )
        return JointSystem(found.cost, found.gradient[at], found.hessian[np.ix_(at, at)])

    @property
    def late(self) -> Floats[C]:
        """Of how much later a moment than expected each camera's image is [frames]: below 0 where it is late."""
        return self.values[:, LATE] - np.array(self.ahead, float) - self.expected

    def seen_poses(self, camera: int, poses: Floats[F, P], velocity: Floats[F, P]) -> SeenPoses:
        """Return how a camera sees the hand; velocity: of the poses [a frame], as `motion.moved` takes it."""
        values, seen = self.values[camera], self.cameras[camera]
        on = values[LATE] * velocity
        then = moved(poses, on)
        turn, axis = rotation_matrix(values[TURNED]), seen.rotation[2]
        zoom = np.eye(3) - values[ZOOMED] * np.outer(axis, axis)
        arm = (then[:, PLACE] - seen.centre) @ turn.T
        step = np.zeros_like(poses)
        step[:, TURN] = values[TURNED]
        found = moved(then, step)
        found[:, PLACE] = seen.centre + values[SHIFTED] + arm @ zoom.T
        by_pose = np.zeros((len(poses), 6, 6))
        by_pose[:, PLACE, PLACE] = zoom @ turn
        by_pose[:, TURN, TURN] = turn @ rotation_matrix(on[:, TURN])
        by_camera = np.zeros((*poses.shape, 8))
        turned = left_jacobian(values[TURNED])
        by_camera[:, PLACE, TURNED] = -zoom @ skew(arm) @ turned
        by_camera[:, TURN, TURNED] = turned
        by_camera[:, PLACE, SHIFTED] = np.eye(3)
        by_camera[:, PLACE, ZOOMED] = -np.outer(arm @ axis, axis)
        by_camera[:, :, LATE] = velocity
        by_camera[:, PLACE, LATE] = velocity[:, PLACE] @ (zoom @ turn).T
        by_camera[:, TURN, LATE] = velocity[:, TURN] @ turn.T
        return SeenPoses(found, by_pose, by_camera[:, :, self.free])

    @property
    def common(self) -> float:
        """By how many frames most cameras are later than expected."""
        if not self.count or not self.free[LATE]:
            return 0.0
        off = (self.late[:, None] - self.late) / _LATE_FRAMES
        return float(self.late[np.log1p(off**2).sum(axis=0).argmin()])

    def earlier(self, frames: float) -> CameraChanges:
        """Return the same by a clock that is so many frames ahead."""
        values = self.values.copy()
        values[:, LATE] -= frames
        return replace(self, values=values)

    def whole_frames(self) -> CameraChanges:
        """Return the same where other images of a camera are looked at, as soon as one is clearly nearer in time."""
        late = self.values[:, LATE]
        step = np.where(np.abs(late) > _OTHER_FRAME, np.rint(late), 0.0).astype(int)
        values = self.values.copy()
        values[:, LATE] -= step
        ahead = tuple((np.array(self.ahead, int) - step).tolist())
        return replace(self, values=values, ahead=ahead)

    def corrected(self) -> tuple[Camera, ...]:
        """Return the cameras as they must have been to see what they saw."""
        found = []
        for camera, values in zip(self.cameras, self.values, strict=True):
            turn = rotation_matrix(values[TURNED])
            rotation = camera.rotation @ turn
            centre = camera.centre - turn.T @ values[SHIFTED]
            matrix = camera.matrix * np.array(
                [[1.0 + values[ZOOMED]], [1.0 + values[ZOOMED]], [1.0]]
            )
            matrix[:2, 2] = camera.matrix[:2, 2]
            found.append(
                replace(camera, matrix=matrix, rotation=rotation, translation=-rotation @ centre)
            )
        return tuple(found)


def velocities(poses: Floats[F, P]) -> Floats[F, P]:
    """Return how fast poses change [a frame]: the mean of the steps before and after each; zero for a single one."""
    steps = changes(poses)
    if not len(steps):
        return np.zeros_like(poses)
    return 0.5 * (np.concatenate([steps[:1], steps]) + np.concatenate([steps, steps[-1:]]))
