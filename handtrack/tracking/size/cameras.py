"""Small changes of the cameras, the same in all frames: how each sees the hand, and what is known of them beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace

import numpy as np

from handtrack.arrays import D6, D12, Array, C, F, Floats, Ints, K, L, P, array_dataclass
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import left_jacobian, rotation_matrix, skew
from handtrack.model.pose_changes import PLACE, TURN, changes, moved
from handtrack.observation.observation import CLOUD_NAME, Observation
from handtrack.terms.term import JointSystem

_TURN_RAD, _SHIFT_M, _ZOOM = np.deg2rad(0.5), 0.002, 0.005
"""what a calibration may be off by: a camera that was touched after it, or a board that was not flat. Of turn and shift the length. A
detector's bias may be as much, or any: a Cauchy distribution, under which one camera that joints say is turned costs less than all others"""
_LATE_FRAMES = 0.5
"""cameras that run free, each by its own clock, are out of step by up to half a frame; one that dropped frames may be late by any
number: a Cauchy distribution, under which one camera that is two frames late costs less than three that share it. With 0.1, 0.17 and
0.38 of half a frame were found of two real cameras, and 0.1 of a frame and a half of a slow hand"""
IN_STEP = 0.1
"""frames by which time offsets that are found of cameras in step differ: those that differ by more have no time in common"""
_COMMON_ZOOM = 1e-5
"""what all cameras are zoomed by together is the hand's size, or masks that are all too wide, and no camera's: held at nothing"""
_WIDER_M = 0.0015
"""the usual error of an outline (`silhouettes.outline_sigma_mm`), all along it; eleven cameras of three recordings: 0.9 mm"""
_TURN = [_TURN_RAD / 3**0.5] * 3
_SIGMA = np.array(_TURN + [_SHIFT_M / 3**0.5] * 3 + [_ZOOM, np.inf, _WIDER_M] + _TURN)
_OTHER_FRAME = 0.75
"""frames by which a camera must be late before its next image is nearer for sure: half a frame, and a margin against going to
and fro"""
TURNED, SHIFTED, ZOOMED, LATE, WIDER, BIAS = slice(0, 3), slice(3, 6), 6, 7, 8, slice(9, 12)
NUMBERS = 12
_EACH = np.arange(NUMBERS)
CALIBRATION, TIME, OUTLINE, DETECTOR = (
    _EACH < LATE,
    _EACH == LATE,
    _EACH == WIDER,
    _EACH >= BIAS.start,
)
"""which of a camera's numbers are found: where and what it is, when it saw, how wide its masks are, to which side a detector sees joints"""


@array_dataclass
class CameraPoses:
    """The hand of all frames as one camera sees it."""

    poses: Floats[F, P]
    """solver parameters at which the camera's terms are evaluated"""
    by_pose: Floats[F, D6, D6]
    """by how much place and turn there change with those of the poses; all else is the same"""
    by_camera: Floats[F, P, D12]
    """by how much they change with the camera; changes as `pose_changes.moved` makes them"""
    wider_m: float
    """see `CameraChanges`"""
    by_outline: Floats[K]
    """by how much farther out outlines are with each of the camera's free numbers [m]"""
    first: int
    """which of all cameras' free numbers is the first of these"""


@array_dataclass
class CameraChanges:
    """Twelve numbers a camera: turn [rad] and shift [m] in world axes about its centre, zoom (a share), how late it is [frames], by how
    much its masks are wider than the hand, all along their outlines [m], and a detector's bias: a further turn [rad] of it for joints alone.

    A camera that is turned and shifted sees what it would see, were the hand moved the opposite way. These are the hand's: of the
    camera they are the opposite (`corrected`). A longer focal length is a hand that is nearer by the same share of its depth:
    true to that share of the hand's own depth, a tenth. A camera that is late shows the hand of earlier: `late` is negative where
    its image shows what came before.
    """

    cameras: tuple[Camera, ...]
    """as they were calibrated"""
    values: Floats[C, D12]
    ahead: tuple[int, ...]
    """which of a camera's images is looked at beside a frame, in frames after it: what is late by whole frames"""

    free: Array[D12] = field(default_factory=lambda: np.ones(NUMBERS, bool))
    """which are found; the others stay as they are"""
    known: Floats[L, F] | float = 0.0
    """[frames] by which each frame of theirs, and last of a cloud, is later as far as is known beforehand; how late they are comes on top"""
    cloud: Floats[C] | float = 0.0
    """each camera's share of a cloud's time, which is the mean of those that measured it; nothing of one that shows nothing else"""
    detected: bool = False
    """whether a detector's joints tell of them"""
    masked: bool = True
    """whether masks do; by joints alone a detector's bias is the camera's turn for all that is known"""

    @classmethod
    def of(
        cls, frames: Sequence[Observation] = (), frames_later: Sequence[Mapping[str, float]] = ({},)
    ) -> CameraChanges:
        """Return those that may change, of masks and joints in some frames, where two can tell; as they were calibrated.

        frames_later: of each frame of the recording, by camera, and of the cloud, how many frames later it is, as far as is known.
        """
        seen, measured = dict[str, Camera](), set[str]()
        for one in frames:
            joints = one.image_keypoints
            seen |= {view.camera.name: view.camera for view in (*one.silhouettes, *joints)}
            measured.update(one.cloud_cameras)
        names = seen if len(seen) > 1 else ()
        count = len(names)
        known = [[one.get(name, 0.0) for one in frames_later] for name in (*names, CLOUD_NAME)]
        cloud = np.array([name in measured for name in names], float) / max(len(measured), 1)
        detected = any(one.image_keypoints for one in frames)
        masked = any(one.silhouettes for one in frames)
        return cls(
            tuple(seen[name] for name in names), np.zeros((count, NUMBERS)), (0,) * count,
            known=np.array(known), cloud=cloud, detected=detected, masked=masked,
        )  # fmt: skip

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(camera.name for camera in self.cameras)

    @property
    def count(self) -> int:
        """How many numbers there are to find."""
        return len(self.cameras) * int(self.free.sum())

    def finding(self, free: Array[D12]) -> CameraChanges:
        """Return the same, of which other numbers are found from now on."""
        return replace(self, free=free)

    def stepped(self, step: Floats[K]) -> CameraChanges:
        """Return the changes after a step of all numbers."""
        values = self.values.copy()
        values[:, self.free] += step.reshape(len(values), int(self.free.sum()))
        return replace(self, values=values)

    def prior(self, weight: Floats[D12] = np.ones(NUMBERS)) -> JointSystem:
        """Return what is known of them before anything is seen, each of the twelve weighing so much, by the free numbers (K,)."""
        plain, late = self.values / _SIGMA, self.late
        told, count = 1.0 / (_LATE_FRAMES**2 + late**2), max(len(late), 1)
        aside = (plain[:, BIAS] ** 2).sum(axis=1, keepdims=True)
        plain[:, BIAS] = 0.0
        zoomed = float(self.values[:, ZOOMED].sum()) / count
        cost = 0.5 * (weight * plain**2).sum() + 0.5 * weight[ZOOMED] * (zoomed / _COMMON_ZOOM) ** 2
        cost += 0.5 * weight[LATE] * np.log1p((late / _LATE_FRAMES) ** 2).sum()
        cost += 0.5 * weight[BIAS.start] * np.log1p(aside).sum()
        gradient, hessian = plain / _SIGMA, np.tile(_SIGMA**-2, (len(late), 1))
        gradient[:, LATE], hessian[:, LATE] = late * told, told
        hessian[:, BIAS] /= 1.0 + aside
        gradient[:, BIAS] = self.values[:, BIAS] * hessian[:, BIAS]
        gradient[:, ZOOMED] += zoomed / (count * _COMMON_ZOOM**2)
        hessian = np.diag((weight * hessian).ravel())
        hessian[ZOOMED::NUMBERS, ZOOMED::NUMBERS] += weight[ZOOMED] / (count * _COMMON_ZOOM) ** 2
        at = np.flatnonzero(np.tile(self.free, len(late)))
        return JointSystem(float(cost), (weight * gradient).ravel()[at], hessian[np.ix_(at, at)])

    @property
    def late(self) -> Floats[C]:
        """Of how much later a moment than expected each camera's image is [frames]: below 0 where it is late."""
        return self.values[:, LATE] - np.array(self.ahead, float)

    @property
    def cloud_ahead(self) -> int:
        """Which frame's cloud is looked at beside a frame, in frames after it."""
        return round(float(np.sum(self.cloud * np.array(self.ahead))))

    def views(self, poses: Floats[F, P], velocity: Floats[F, P]) -> list[CameraPoses]:
        """Return how each camera sees the hand, then how a detector sees its joints there; last how clouds do, whose time changes with their
        cameras'.

        velocity: of the poses [a frame], as `pose_changes.moved` takes it.
        """
        found = list[CameraPoses]()
        for by_joints in (False, True) if self.cameras else ():
            found += self._camera_poses(poses, velocity, by_joints)
        if np.any(self.cloud):
            on = self.moments(len(poses))[-1][:, None] * velocity
            by_pose = np.tile(np.eye(6), (len(poses), 1, 1))
            by_pose[:, TURN, TURN] = rotation_matrix(on[:, TURN])
            by_late = np.zeros((*poses.shape, len(self.cameras), NUMBERS))
            by_late[..., LATE] = velocity[..., None] * self.cloud
            by_camera = by_late[..., self.free].reshape(*poses.shape, -1)
            none = np.zeros(self.count)
            found.append(CameraPoses(moved(poses, on), by_pose, by_camera, 0.0, none, 0))
        return found

    def _camera_poses(
        self, poses: Floats[F, P], velocity: Floats[F, P], by_joints: bool
    ) -> list[CameraPoses]:
        """Return how each camera, or a detector in its images, sees the hand; all are found at once, in arrays (C, F, …)."""
        values = self.values[:, None].copy()
        values[..., TURNED] += by_joints * values[..., BIAS]
        on = self.moments(len(poses))[:-1, :, None] * velocity
        then = moved(poses, on)
        centre = np.array([[camera.centre] for camera in self.cameras])
        axis = np.array([[camera.rotation[2]] for camera in self.cameras])
        across = np.swapaxes(axis, 1, 2)
        turn, turned = rotation_matrix(values[..., TURNED]), left_jacobian(values[..., TURNED])
        zoom = np.eye(3) - values[..., ZOOMED, None, None] * (across * axis)[:, None]
        arm = (then[..., PLACE] - centre) @ np.swapaxes(turn[:, 0], 1, 2)
        step = np.zeros_like(then)
        step[..., TURN] = values[..., TURNED]
        found = moved(then, step)
        found[..., PLACE] = centre + values[..., SHIFTED] + arm @ np.swapaxes(zoom[:, 0], 1, 2)
        by_pose = np.zeros((*then.shape[:2], 6, 6))
        by_pose[..., PLACE, PLACE] = zoom @ turn
        by_pose[..., TURN, TURN] = turn @ rotation_matrix(on[..., TURN])
        by_camera = np.zeros((*then.shape, NUMBERS))
        by_camera[..., PLACE, TURNED] = -zoom @ skew(arm) @ turned
        by_camera[..., TURN, TURNED] = turned
        by_camera[..., PLACE, SHIFTED] = np.eye(3)
        by_camera[..., PLACE, ZOOMED] = -(arm @ across) * axis
        by_camera[..., LATE] = velocity
        by_camera[..., PLACE, LATE] = velocity[:, PLACE] @ np.swapaxes((zoom @ turn)[:, 0], 1, 2)
        by_camera[..., TURN, LATE] = velocity[:, TURN] @ np.swapaxes(turn[:, 0], 1, 2)
        by_camera[..., BIAS] = by_joints * by_camera[..., TURNED]
        by_camera, by_outline = by_camera[..., self.free], OUTLINE[self.free].astype(float)
        wider, first = self.values[:, WIDER].tolist(), int(self.free.sum())
        return [
            CameraPoses(found[k], by_pose[k], by_camera[k], wider[k], by_outline, first * k)
            for k in range(len(self.cameras))
        ]

    def moments(self, frames: int) -> Floats[L, F]:
        """Return how much later than a frame each camera saw the image that is looked at beside it, and last when a cloud was measured, of so many frames."""
        ahead = np.array([*self.ahead, self.cloud_ahead])
        found = np.append(self.late, np.sum(self.cloud * self.late)) + ahead
        known = np.broadcast_to(self.known, (len(found), frames))
        beside = np.arange(frames) + ahead[:, None]
        return found[:, None] + np.take_along_axis(known, beside.clip(0, frames - 1), 1)

    @property
    def common(self) -> float:
        """By how many frames most cameras are later than expected."""
        if not self.count or not self.free[LATE]:
            return 0.0
        off = (self.late[:, None] - self.late) / IN_STEP
        return float(self.late[np.log1p(off**2).sum(axis=0).argmin()])

    def earlier(self, frames: Ints[C] | float) -> CameraChanges:
        """Return the same by a clock that is so many frames ahead."""
        values = self.values.copy()
        values[:, LATE] -= frames
        return replace(self, values=values)

    def whole_frames(self) -> CameraChanges:
        """Return the same where other images of a camera are looked at, as soon as one is clearly nearer in time."""
        late = self.values[:, LATE]
        step = np.where(np.abs(late) > _OTHER_FRAME, np.rint(late), 0.0).astype(int)
        return replace(self.earlier(step), ahead=tuple((np.array(self.ahead) - step).tolist()))

    def corrected(self, by_joints: bool = False) -> tuple[Camera, ...]:
        """Return the cameras as they must have been to see what they saw, or what a detector saw in their images."""
        found = []
        for camera, values in zip(self.cameras, self.values, strict=True):
            turn = rotation_matrix(values[TURNED] + by_joints * values[BIAS])
            rotation = camera.rotation @ turn
            centre = camera.centre - turn.T @ values[SHIFTED]
            matrix = camera.matrix.copy()
            matrix[:2, :2] *= 1.0 + values[ZOOMED]
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
