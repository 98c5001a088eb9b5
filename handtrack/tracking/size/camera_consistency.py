"""Which camera the others contradict, by its direction or its lens, where poses and the hand's size give way to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, D6, B, Floats, K, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BoneFields, BonePoses
from handtrack.model.size import SizeParameters
from handtrack.observation.observation import ImageKeypoints, Observation, Silhouette
from handtrack.solver.problem import Problem
from handtrack.terms.term import JointSystem
from handtrack.tracking.frame.frame_task import FrameTask
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.size.person import is_stopped

KINDS = {"direction": range(3), "lens": range(3, 5)}
"""which of a camera's five numbers each changes"""
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
    frames = [FrameTask(model, alone, observed, pose) for observed, pose in seen]
    views = [
        {v.camera.name: v for v in (*one.silhouettes, *one.image_keypoints)} for one, _ in seen
    ]
    names = list(dict.fromkeys(name for one in views for name in one))
    if len(names) < 2:
        return []
    told = (_without_pose(*one, names) for one in zip(frames, views, strict=True))
    total = sum(told, JointSystem.zero(1 + 5 * len(names)))
    gradient, hessian = total.gradient.copy(), total.hessian.copy()
    gradient[0] += size.deviations(model.scale)[0]
    hessian[0, 0] += 1.0
    found = []
    for name in names:
        for kind, own in KINDS.items():
            at = [0, *(_place(names, name) + k for k in own)]
            pull, stiff = gradient[at], hessian[np.ix_(at, at)]
            step = -np.linalg.solve(stiff + 1e-9 * np.diag(np.diag(stiff) + 1e-9), pull)
            gain = -0.5 * float(pull @ step) - 0.5 * float(pull[0] ** 2 / stiff[0, 0])
            change = np.zeros(5)
            change[own] = step[1:]
            off = np.concatenate(
                [
                    _off_px(model, model.bones(frame.start), view[name], change)
                    for frame, view in zip(frames, views, strict=True)
                    if name in view
                ]
            )
            off_px, turn = float(np.sqrt(np.nanmean(off**2))), float(np.linalg.norm(change[:3]))
            share = gain / max(total.cost, 1e-9)
            found.append(CameraInconsistency(name, kind, gain, share, off_px, turn))
    return sorted(found, key=lambda one: -one.gain)


def _place(names: Sequence[str], name: str) -> int:
    """Return where a camera's five numbers begin, after the overall size."""
    return 1 + 5 * names.index(name)


def _without_pose(
    frame: FrameTask, views: dict[str, Silhouette | ImageKeypoints], names: Sequence[str]
) -> JointSystem:
    """Return what a frame's cameras say of the overall size (1) and of five numbers of each, the pose following.

    Parameters
    ----------
    views
        Of each camera that saw the frame one, by its name.
    """
    model, observed, count = frame.model, frame.observation, len(frame.start)
    points, width = len(model.joint_names), count + 1 + 5 * len(names)
    bones, twists, _ = model.linearize(frame.start)
    moves = BoneFields.of_twists(twists @ model.transform.matrix, points)
    moves = moves.beside(SizeParameters(model).fields(bones, np.arange(1)))
    system = JointSystem.zero(width)
    for name, view in views.items():
        own = Observation(
            observed.frame,
            observed.time_s,
            tuple(one for one in observed.silhouettes if one.camera.name == name),
            tuple(one for one in observed.image_keypoints if one.camera.name == name),
        )
        terms = frame_terms(model, frame.settings, own, bones).wide().stage(bones, 0)
        fields = moves.beside(BoneFields.of_twists(_changes(model, bones, view), points))
        first = count + _place(names, name)
        at = np.eye(width)[[*range(count + 1), *range(first, first + 5)]]
        told = (term.linearize(bones, fields) for term in terms)
        system += sum(told, JointSystem.zero(len(at))).pull_back(at)
    prior = Problem(model, (), frame.terms(frame.start).priors).linearize(frame.start)
    known = prior.pull_back(np.eye(count, width))
    pull, stiff = system.gradient + known.gradient, system.hessian + known.hessian
    low, high = model.bounds(frame.start).T
    free = np.flatnonzero(~is_stopped(frame.start, low, high, pull[:count]))
    left, held = slice(count, None), stiff[np.ix_(free, free)]
    held = held + _RIDGE * np.diag(np.diag(held) + 1.0)
    mixed = stiff[free, left]
    follow = np.linalg.solve(held, np.column_stack([mixed, pull[free]]))
    return JointSystem(
        system.cost,
        pull[left] - mixed.T @ follow[:, -1],
        stiff[left, left] - mixed.T @ follow[:, :-1],
    )


def _off_px(
    model: ArticulatedModel,
    bones: BonePoses,
    view: Silhouette | ImageKeypoints,
    change: Floats[K],
) -> Floats[B]:
    """Return by how much a change of a camera's five numbers moves the bones' middles in its images [px]."""
    middle, twist = _middles(model, bones), _changes(model, bones, view) @ change
    moved = middle + twist[:, :3] + np.cross(twist[:, 3:6], middle - bones.reference)
    return np.linalg.norm(view.camera.project(moved) - view.camera.project(middle), axis=1)


def _changes(
    model: ArticulatedModel, bones: BonePoses, view: Silhouette | ImageKeypoints
) -> Floats[B, D6, K]:
    """Return how the bones would have to move to look as they do to a camera of which each of five numbers changes by one.

    Three angles [rad] about world axes, and two coefficients of its lens, of the square and the fourth power of
    the distance from its axis, taken where the bones' middles are.
    """
    camera, moved = view.camera, np.zeros((len(bones.position), 6, 5))
    moved[:, 3:, :3] = np.eye(3)
    moved[:, :3, :3] = np.cross(np.eye(3), bones.reference - camera.centre).T
    there = camera.to_camera(_middles(model, bones))
    ray = there[:, :2] / there[:, 2:]
    for k in range(2):
        off = ray * (ray**2).sum(axis=1)[:, None] ** (k + 1) * there[:, 2:]
        moved[:, :3, 3 + k] = np.column_stack([off, np.zeros(len(off))]) @ camera.rotation
    return moved


def _middles(model: ArticulatedModel, bones: BonePoses) -> Floats[B, D3]:
    return bones.position + 0.5 * model.skeleton.length[:, None] * bones.rotation[:, :, 1]
