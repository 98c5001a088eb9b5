"""Frame after frame, forward from the first pose and backward before it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from handtrack.arrays import Floats, P
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.hypotheses.sequence_path import Carried, chosen_sequence
from handtrack.tracking.pursuit import Observe, Pursuit
from handtrack.tracking.state import TrackerState
from handtrack.tracking.tracker import Tracker


def track_frames(
    tracker: Tracker,
    observe: Observe,
    start_frame: int,
    start_params: Floats[P],
    frames: range,
    control: Control = Control(),
) -> Iterator[FrameResult]:
    """Yield a result for every frame of `frames`, in the order of tracking.

    The start frame comes first, then the later ones, then the earlier ones backward from it. When the start
    lies outside `frames`, it is still solved there first, so that the path to the range is tracked, but only
    the range is yielded. A step cut short by `control.should_stop` is not yielded. Where several hypotheses are carried
    and `mixture.sequence` asks for more than the best of each frame, frames come again once the last one is done, with
    the poses that it chose: the latest of a frame holds.
    """
    control = _shown_within(frames, control)
    state = TrackerState.beginning_at(start_params)
    forward = range(start_frame, max(frames.stop, start_frame + 1))
    backward = range(start_frame - 1, frames.start - 1, -1)
    first, begun = state, list[Carried]()
    for path in (forward, backward):
        carried = list(begun)
        for after, result in Pursuit(tracker, observe, state, control).frames(path):
            if result.frame == start_frame:
                first, begun = after, [(result, after.hypotheses)]
            carried.append((result, after.hypotheses))
            if result.frame in frames:
                yield result
        if control.should_stop():
            return
        state = first
        yield from _chosen(tracker, carried[path is backward :], frames)


def _shown_within(frames: range, control: Control) -> Control:
    """Return the control, shown only what is yielded too."""
    show = control.on_early
    if show is None:
        return control
    return replace(control, on_early=lambda result: result.frame in frames and show(result))


def _chosen(tracker: Tracker, carried: list[Carried], frames: range) -> Iterator[FrameResult]:
    """Yield the frames of one direction whose poses the last one changes."""
    chosen = chosen_sequence(tracker.model, tracker.settings, carried)
    for (result, _), now in zip(carried, chosen, strict=True):
        if now is not result and now.frame in frames:
            yield now
