"""Frame after frame, forward from the first pose and backward before it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import takewhile

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation
from handtrack.tracking.find_pose import SURE
from handtrack.tracking.frame.control import Control, Observe
from handtrack.tracking.frame.frame_task import TrackerState
from handtrack.tracking.frame.result import FrameResult, Status, Step, unconfirmed
from handtrack.tracking.speculative import SpeculativeExecution
from handtrack.tracking.tracker import Tracker
from handtrack.tracking.whole.likelihood import (
    MOSTLY_NEW,
    Recording,
    RecordingLikelihood,
    new_share,
)
from handtrack.tracking.whole.recording_estimate import refine, refine_near


def track_recording(
    tracker: Tracker,
    observe: Observe,
    start_frame: int,
    start_params: Floats[P],
    frames: range,
    control: Control = Control(),
    done: Sequence[Step] = (),
) -> Iterator[FrameResult]:
    """Yield results as `track_frames` does; then all of them again, refined together, where the settings ask for it."""
    found = {step.result.frame: step.result for step in done if step.result.frame in frames}
    live = track_frames(tracker, observe, start_frame, start_params, frames, control, done)
    for result in live:
        found[result.frame] = result
        yield result
    if tracker.settings.refines and control.refines and not control.should_stop():
        tracked = [found[frame] for frame in sorted(found)]
        segment = start_frame, start_params, frames
        tracked = tracked_by_new_share(tracker, observe, tracked, [segment], control)
        yield from refine_recording(tracker, observe, tracked, control)


def tracked_by_new_share(
    tracker: Tracker,
    observe: Observe,
    tracked: Sequence[FrameResult],
    segments: Iterable[tuple[int, Floats[P], range]],
    control: Control,
) -> Sequence[FrameResult]:
    """Return tracked frames, ascending: tracked again, counting joints less, where most of what one
    camera's joints say of a frame was said before (`whole.likelihood.new_share`).

    The same where anything else was seen, there is one hypothesis, or it is stopped.

    Hypotheses that each frame weighs as if it were the first are given up too surely: of a real
    person before one camera those with the right limbs were.

    Parameters
    ----------
    segments
        First frame, its solver parameters, and frames of each.
    """
    model, settings = tracker.model, tracker.settings
    if settings.tracker.hypotheses < 2 or settings.traits.closest_prior:
        return tracked
    posed = [result for result in tracked if result.status != Status.LOST]
    poses = np.array([model.solver_params(r.parameters) for r in posed])
    frames = [result.frame for result in posed]
    around = dict(zip(frames, poses, strict=True))
    recording = Recording(model, settings, observe)
    share = new_share(RecordingLikelihood(recording, around, 1.0), frames, poses)
    if share > MOSTLY_NEW:
        return tracked
    traits = replace(settings.traits, new_share=share)
    tracker = replace(tracker, settings=replace(settings, traits=traits))
    # as a pass of its own: nothing of it is kept, and nobody looks at it
    quiet = Control(control.should_stop, waits=control.waits)
    again = [r for one in segments for r in track_frames(tracker, observe, *one, quiet)]
    return sorted(again, key=lambda r: r.frame) if len(again) == len(tracked) else tracked


def refine_recording(
    tracker: Tracker,
    observe: Observe,
    tracked: Sequence[FrameResult],
    control: Control = Control(),
    held: Mapping[int, Floats[P]] | None = None,
    changed: Sequence[int] | None = None,
    pinned: Mapping[int, Floats[P]] | None = None,
) -> list[FrameResult]:
    """Return tracked frames, ascending, refined together.

    Parameters
    ----------
    held
        Solver parameters of frames that a person posed, which stay so.
    pinned
        Of frames where a person's pins led.
    changed
        At which frames such were set or let go since the frames were refined; only what those touch
        is done, and returned. None: everything, and what may be found of the person, the tracker's
        `subject`.
    """

    def observed(frame: int, bones: BonePoses | None = None) -> Observation:
        return tracker.with_custom_terms(observe(frame, bones))

    recording = Recording(
        tracker.model,
        tracker.settings,
        observed,
        control,
        held or {},
        pinned or {},
        tracker.subject,
        tracker.cameras,
    )
    again = (
        refine(recording, tracked) if changed is None else refine_near(recording, tracked, changed)
    )
    sure = {Status.TRACKED, Status.KEYFRAME}
    if tracker.start_confidence >= SURE or held or any(r.status in sure for r in tracked):
        return again
    return [
        unconfirmed(r, tracker.start_confidence) if r.status == Status.TRACKED else r for r in again
    ]


def track_frames(
    tracker: Tracker,
    observe: Observe,
    start_frame: int,
    start_params: Floats[P],
    frames: range,
    control: Control = Control(),
    done: Sequence[Step] = (),
) -> Iterator[FrameResult]:
    """Yield a result for every frame of `frames`, in the order of tracking: the live pass, in which
    each knows those before.

    The start frame comes first, then the later ones, then the earlier ones backward from it. When
    the start lies outside `frames`, it is still solved there first, so that the path to the range
    is tracked, but only the range is yielded. A step cut short by `control.should_stop` is not
    yielded.

    Parameters
    ----------
    done
        What `control.observer` was told of the same tracking before it was stopped. It goes on where
        these end, as it would have; they are not yielded again.
    """

    def show(result: FrameResult) -> None:
        if result.frame in frames:
            control.observer.provisional(result)

    known = {step.result.frame: step for step in done}
    forward = range(start_frame, max(frames.stop, start_frame + 1))
    backward = range(start_frame - 1, frames.start - 1, -1)
    begun: list[Step] = []
    for path in (forward, backward):
        steps = [*begun, *(known[frame] for frame in takewhile(known.__contains__, path))]
        state = TrackerState.beginning_at(start_params)
        if steps:
            state = _state_after(steps, tracker, observe)
        todo = path[len(steps) - len(begun) :]
        execution = SpeculativeExecution(tracker, observe, state, control, show)
        for after, result in execution.frames(todo):
            if not steps:
                steps.append(after.step)
            control.observer.step(after.step)
            if result.frame in frames:
                yield result
        if control.should_stop():
            return
        begun = steps[:1]


def _state_after(steps: Sequence[Step], tracker: Tracker, observe: Observe) -> TrackerState:
    """Return the state in which steps left the tracker; images that it looks back on are read again."""
    if not tracker.settings.uses_images:
        return TrackerState.after_steps(steps)
    first, *others = (step.result for step in steps)
    last = next((r for r in reversed(others) if r.status != Status.LOST), None)
    texture = tracker.texture_from(observe(first.frame, None), first)
    if last is not None and texture is not None:
        now = tracker.texture_from(observe(last.frame, None), last)
        texture = now and replace(now, first=texture)
    return TrackerState.after_steps(steps, texture)
