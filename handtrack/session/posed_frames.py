"""Poses that a person decided for single frames, as the session's store has them: keyframes, guides and accepted frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, S
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Observation
from handtrack.session.layout import TRACKS_FOLDER
from handtrack.session.run import TrackingRun
from handtrack.session.session_state import marked_frames, readable
from handtrack.store.store import Store
from handtrack.tracking.frame.frame_task import posed_result
from handtrack.tracking.frame.result import FrameResult, Status


def posed_frames(
    run: TrackingRun,
) -> tuple[TrackingRun, dict[int, FrameResult], dict[int, Floats[S]]]:
    """Return what a person decided in the workbench for frames of a recording. Poses of another model count by names.

    Returns
    -------
    run
        with the size and forearm for which the poses were set
    fixed
        keyframes and accepted frames, ascending
    guides
        joint parameters where pins or tuned settings led the solver: tracking starts again from there and solves these frames, too
    """
    store = Store(run.session.folder / TRACKS_FOLDER)
    state, frames = readable(store.state()), run.session.known_frames
    decided = {frame: pose for frame, pose in state.pose.items() if not pose.carried}
    if (
        decided
    ):  # the size and forearm that were found or set; a size still to be fitted does not count
        size, arm_m = state.size, state.forearm
        if arm_m is not None and arm_m != run.arm_m:
            run = run.with_forearm(arm_m)
        if size is not None and not size.pending:
            run = run.with_scale(size.scale)
    model = run.model
    fixed, guides = dict[int, FrameResult](), dict[int, Floats]()
    rest = model.joint_params(run.initial()[1] if run.first is not None else model.rest_params())
    for frame, known in decided.items():
        if frame not in frames:
            continue
        names = zip(model.parameter_names, rest, strict=True)
        pose = np.array([known.parameters.get(name, float(at)) for name, at in names])
        if known.is_led:
            guides[frame] = pose
        else:
            fixed[frame] = keyframe_result(run, frame, pose)
    accepted = marked_frames(state)["accepted"]
    for frame in accepted & guides.keys():
        fixed[frame] = keyframe_result(run, frame, guides.pop(frame))
    fixed |= _tracked(store, model, accepted.intersection(frames) - fixed.keys())
    return run, dict(sorted(fixed.items())), dict(sorted(guides.items()))


def _tracked(
    store: Store, model: ArticulatedModel, wanted: frozenset[int]
) -> dict[int, FrameResult]:
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
    params = model.solver_params(values)
    seen = Observation(frame, float(run.session.time_s(frame)))
    return replace(posed_result(model, seen, params, Status.KEYFRAME), parameters=values)
