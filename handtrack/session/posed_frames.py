"""Poses that a person decided for single frames, as the session's store has them: keyframes, guides and accepted frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import Floats, P, S
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import scale_from
from handtrack.session.layout import TRACKS_FOLDER
from handtrack.session.run import TrackingRun
from handtrack.store.store import ACCEPTED, Store
from handtrack.tracking.frame.result import FrameResult, Status

_POSE = "pose/"  # of a key of the store's state; the frame follows
_SIZE, _FOREARM = "size", "forearm"
_LED = ("pinned", "refitted")  # the solver led there; a person did not pose it
_FAR = 100.0  # [m] no hand is further from the world's origin


@dataclass(frozen=True, eq=False)
class PosedFrames:
    """Poses that tracking keeps, or starts again from; joint parameters by frame."""

    run: TrackingRun
    """with the size and forearm for which a person set the poses"""
    fixed: dict[int, FrameResult]
    """keyframes and accepted frames"""
    guides: dict[int, Floats[S]]
    """where pins or tuned settings led the solver: tracking starts again from there and solves these frames, too"""

    def without(self, frame: int) -> PosedFrames:
        """Return all but a frame's pose."""
        fixed = {f: result for f, result in self.fixed.items() if f != frame}
        return PosedFrames(
            self.run, fixed, {f: pose for f, pose in self.guides.items() if f != frame}
        )


def posed_frames(run: TrackingRun) -> PosedFrames:
    """Return what a person decided in the workbench for frames of a recording. Poses of another model count by names."""
    store = Store(run.session.folder / TRACKS_FOLDER)
    state, frames = store.history().state, run.session.known_frames
    if any(key.startswith(_POSE) and not value.get("carried") for key, value in state.items()):
        run = _sized(run, state)
    model = run.model
    fixed, guides = dict[int, FrameResult](), dict[int, Floats]()
    rest = model.joint_params(run.initial()[1] if run.first is not None else model.rest_params())
    for key, value in state.items():
        frame = int(key.removeprefix(_POSE)) if key.startswith(_POSE) else -1
        if frame not in frames or value.get("carried", False):
            continue
        known = value["parameters"]
        pose = np.array(
            [float(known.get(n, at)) for n, at in zip(model.parameter_names, rest, strict=True)]
        )
        if any(value.get(name, False) for name in _LED):
            guides[frame] = pose
        else:
            fixed[frame] = keyframe_result(run, frame, pose)
    accepted = {f for first, stop in state.get(ACCEPTED) or () for f in range(first, stop)}
    for frame in accepted & guides.keys():
        fixed[frame] = keyframe_result(run, frame, guides.pop(frame))
    fixed |= _tracked(store, model, (accepted & set(frames)) - fixed.keys())
    return PosedFrames(run, dict(sorted(fixed.items())), dict(sorted(guides.items())))


def _sized(run: TrackingRun, state: Mapping[str, Any]) -> TrackingRun:
    """Return the run with the size and forearm that were found or set in the workbench; one still to be fitted does not count."""
    size, arm = state.get(_SIZE), state.get(_FOREARM)
    if arm is not None and arm != run.arm:
        run = run.with_forearm(np.inf if arm is True else arm)
    if size is None or size.get("pending", False):
        return run
    parts = {key: part for key, part in size.items() if key not in ("pending", "live")}
    return run.with_scale(scale_from(parts, Path("the size of the workbench")))


def _tracked(store: Store, model: ArticulatedModel, wanted: set[int]) -> dict[int, FrameResult]:
    """Return tracked frames of the current track, if they are of this model."""
    found = dict[int, FrameResult]()
    for span in store.current() if wanted else ():
        take = store.take(span.take)
        try:
            names = take.about.labels.parameter_names
        except HandtrackError:  # damaged: the store reports it
            continue
        if names == model.parameter_names:
            results = take.results(range(span.first, span.stop))
            found |= {result.frame: result for result in results if result.frame in wanted}
    return found


def keyframe_result(run: TrackingRun, frame: int, joint_params: Floats[S]) -> FrameResult:
    """Return a frame as a person posed it; nothing is known of its uncertainty."""
    model, values = run.model, np.asarray(joint_params, dtype=float)
    bones = model.bones(model.transform.solver_params(values))
    return FrameResult(
        frame=frame,
        time_s=float(run.session.time_s(frame)),
        parameters=values,
        status=Status.KEYFRAME,
        energy=float("nan"),
        iterations=0,
        parameter_std=np.full(len(values), np.inf),
        joint_covariance=np.tile(np.eye(3), (len(model.joint_names), 1, 1)),
        T_world_bone=bones.T_world_bone,
        joint_positions=model.joint_positions(bones),
        keypoints21=model.keypoints21(bones) if model.has_keypoints21 else None,
    )


def driving_joints(model: ArticulatedModel) -> list[int]:
    """Return (P,) for each solver parameter the joint parameter that stands for it."""
    chosen = []
    for p, name in enumerate(model.transform.names):
        same = name in model.parameter_names
        column = np.abs(model.transform.matrix[:, p])
        chosen.append(model.parameter_names.index(name) if same else int(np.argmax(column)))
    return chosen


def solver_params_of(model: ArticulatedModel, joint_params: Floats[S]) -> Floats[P]:
    """Return solver parameters, within limits, for joint parameters that a person set.

    Under a coupling the driving joints count and the driven ones follow.
    """
    values = np.clip(np.nan_to_num(joint_params, nan=0.0), -_FAR, _FAR)
    transform = model.transform
    params = [
        (values[s] - transform.offset[s]) / transform.matrix[s, p]
        for p, s in enumerate(driving_joints(model))
    ]
    return model.clipped(np.array(params))
