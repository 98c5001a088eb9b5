"""Which camera the others contradict, by its direction or its lens, where poses and the hand's size give way to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from handtrack.arrays import D3, D6, B, Floats, K, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.model.size import SizeParameters
from handtrack.observation.observation import ImageKeypoints, Observation, Silhouette
from handtrack.solver.problem import Problem
from handtrack.terms.bone_system import JointSystem
from handtrack.tracking.frame.frame_task import FrameTask
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.size.person import is_stopped

KINDS = ("direction", "lens")
_BAND_MM = 12.0  # of outlines: a camera that is a degree off shifts a hand at half a metre by 9 mm
_RIDGE = 1e-6  # for joints that nothing holds


@dataclass(frozen=True)
class CameraInconsistency:
    """What would make one camera agree with the others."""

    camera: str
    kind: str
    """one of KINDS"""
    gain: float
    """by how much all frames would fit better [log-likelihood]"""
    share: float
    """of what was seen and is not explained, that this would explain"""
    off_px: float
    """by how much it moves the hand in the camera's images, root mean square"""
    turn_rad: float
    """by how much the camera is turned, 0 for its lens"""


def camera_inconsistencies(
    model: ArticulatedModel,
    settings: TrackerSettings,
    seen: Sequence[tuple[Observation, Floats[P]]],
) -> list[CameraInconsistency]:
    """Return for each camera and kind what it would gain, the largest gain first; none for a single
    camera.

    One step of Gauss and Newton from there: the camera's three angles, or two coefficients of its
    lens, together with all poses and the overall size, which are eliminated.

    Parameters
    ----------
    seen
        Frames, and the solver parameters at which they were tracked.
    """
    size = SizeParameters(model)
    model = size.rescaled(size.deviations(model.scale))
    alone = settings.with_values({"silhouettes.bands_mm": (_BAND_MM,), "tracker.smoothing": 0.0})
    frames = [_Frame(model, alone, observed, pose) for observed, pose in seen]
    frames = [frame for frame in frames if frame.views]
    names = dict.fromkeys(name for frame in frames for name in frame.systems)
    if len(names) < 2:
        return []
    cost = sum(system.cost for frame in frames for system in frame.systems.values())
    found = [_inconsistency(size, frames, name, kind, cost) for name in names for kind in KINDS]
    return sorted(found, key=lambda one: -one.gain)


class _Frame(FrameTask):
    """A frame as its cameras see it at the pose it starts from."""

    @cached_property
    def bones(self) -> BonePoses:
        return self.model.bones(self.start)

    @cached_property
    def views(self) -> dict[str, Silhouette | ImageKeypoints]:
        """Of each camera one, by its name."""
        seen = (*self.observation.silhouettes, *self.observation.image_keypoints)
        return {one.camera.name: one for one in seen}

    @cached_property
    def systems(self) -> dict[str, JointSystem]:
        """What each camera says, by its name, of pose (P), overall size (1), and its own direction (3) and lens (2)."""
        model, observed, points = self.model, self.observation, len(self.model.joint_names)
        bones, twists, _ = model.linearize(self.start)
        moves = BoneFields.of_twists(twists @ model.transform.matrix, points)
        moves = moves.beside(SizeParameters(model).fields(bones, np.arange(1)))
        found: dict[str, JointSystem] = {}
        for name, view in self.views.items():
            own = Observation(
                observed.frame,
                observed.time_s,
                tuple(one for one in observed.silhouettes if one.camera.name == name),
                tuple(one for one in observed.image_keypoints if one.camera.name == name),
            )
            terms = frame_terms(model, self.settings, own, bones).wide().stage(bones, 0)
            changes = [_changes(model, bones, view, kind) for kind in KINDS]
            fields = moves.beside(BoneFields.of_twists(np.concatenate(changes, axis=2), points))
            systems = (term.linearize(bones, fields) for term in terms)
            found[name] = sum(systems, JointSystem.zero(fields.surface.shape[2]))
        return found

    @cached_property
    def prior(self) -> JointSystem:
        """What is known of the pose besides, in its P numbers."""
        return Problem(self.model, (), self.terms(self.start).priors).linearize(self.start)

    def without_pose(self, name: str, kind: str) -> JointSystem:
        """Return the system of the overall size (1) and of a camera's change (K), the pose following."""
        count = len(self.start)
        first, last = (count + 1, count + 4) if kind == "direction" else (count + 4, count + 6)
        chosen = np.eye(count + 6)[:, [*range(count + 1), *range(first, last)]]
        held = chosen * (np.arange(chosen.shape[1]) <= count)
        told = (one.pull_back(chosen if n == name else held) for n, one in self.systems.items())
        system = sum(told, JointSystem.zero(chosen.shape[1]))
        gradient, hessian = system.gradient.copy(), system.hessian.copy()
        gradient[:count] += self.prior.gradient
        hessian[:count, :count] += self.prior.hessian
        low, high = self.model.bounds(self.start).T
        stopped = is_stopped(self.start, low, high, gradient[:count])
        free, left = np.flatnonzero(~stopped), slice(count, None)
        stiff = hessian[np.ix_(free, free)]
        stiff = stiff + _RIDGE * np.diag(np.diag(stiff) + 1.0)
        mixed = hessian[free, left]
        follow = np.linalg.solve(stiff, np.column_stack([mixed, gradient[free]]))
        return JointSystem(
            system.cost,
            gradient[left] - mixed.T @ follow[:, -1],
            hessian[left, left] - mixed.T @ follow[:, :-1],
        )

    def off_px(self, name: str, kind: str, change: Floats[K]) -> Floats[B]:
        """Return by how much a camera's change moves the bones' middles in its images [px]; none where it saw nothing."""
        if name not in self.views:
            return np.zeros(0)
        view, middle = self.views[name], _middles(self.model, self.bones)
        twist = _changes(self.model, self.bones, view, kind) @ change
        moved = middle + twist[:, :3] + np.cross(twist[:, 3:6], middle - self.bones.reference)
        return np.linalg.norm(view.camera.project(moved) - view.camera.project(middle), axis=1)


def _changes(
    model: ArticulatedModel, bones: BonePoses, view: Silhouette | ImageKeypoints, kind: str
) -> Floats[B, D6, K]:
    """Return how the bones would have to move to look as they do to a camera that changes by one of each.

    direction: three angles [rad] about world axes. lens: two coefficients, of the square and the fourth power of
    the distance from its axis, taken where the bones' middles are.
    """
    camera, moved = view.camera, np.zeros((len(bones.position), 6, 3 if kind == "direction" else 2))
    if kind == "direction":
        moved[:, 3:] = np.eye(3)
        moved[:, :3] = np.cross(np.eye(3), bones.reference - camera.centre).T
        return moved
    there = camera.to_camera(_middles(model, bones))
    ray = there[:, :2] / there[:, 2:]
    for k in range(2):
        off = ray * (ray**2).sum(axis=1)[:, None] ** (k + 1) * there[:, 2:]
        moved[:, :3, k] = np.column_stack([off, np.zeros(len(off))]) @ camera.rotation
    return moved


def _middles(model: ArticulatedModel, bones: BonePoses) -> Floats[B, D3]:
    return bones.position + 0.5 * model.skeleton.length[:, None] * bones.rotation[:, :, 1]


def _inconsistency(
    size: SizeParameters, frames: Sequence[_Frame], name: str, kind: str, cost: float
) -> CameraInconsistency:
    first, *others = (frame.without_pose(name, kind) for frame in frames)
    total = sum(others, first)
    gradient, hessian = total.gradient.copy(), total.hessian.copy()
    gradient[0] += size.deviations(size.model.scale)[0]
    hessian[0, 0] += 1.0
    step = -np.linalg.solve(hessian + 1e-9 * np.diag(np.diag(hessian) + 1e-9), gradient)
    gain = -0.5 * float(gradient @ step) - 0.5 * float(gradient[0] ** 2 / hessian[0, 0])
    off = np.concatenate([frame.off_px(name, kind, step[1:]) for frame in frames])
    turn = float(np.linalg.norm(step[1:])) if kind == "direction" else 0.0
    return CameraInconsistency(
        name, kind, gain, gain / max(cost, 1e-9), float(np.sqrt(np.nanmean(off**2))), turn
    )
