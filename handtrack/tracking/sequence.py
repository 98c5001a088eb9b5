"""Frame after frame, forward from the first pose and backward before it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from handtrack.arrays import Floats, P
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.hypotheses.sequence_path import Carried, chosen_sequence
from handtrack.tracking.state import TrackerState
from handtrack.tracking.tracker import Tracker

Observe = Callable[[int, BonePoses | None], Observation]
"""what is seen of a frame; the hand's bones where it is expected tell which points of a cloud are the hand's,
None where that is not known"""


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
    seen = observe(start_frame, tracker.model.bones(start_params))
    first, result = tracker.step(TrackerState.beginning_at(start_params), seen, control)
    if control.should_stop():
        return
    if start_frame in frames:
        yield result
    begun = [(result, first.hypotheses)]
    forward = range(start_frame + 1, frames.stop)
    backward = range(start_frame - 1, frames.start - 1, -1)
    for path in (forward, backward):
        state, carried = first, list(begun)
        for frame in path:
            seen = observe(frame, tracker.expected_bones(state, frame))
            state, result = tracker.step(state, seen, control)
            if control.should_stop():
                return
            if result.alternatives:  # a live source has no last frame: nothing else is kept
                carried.append((result, state.hypotheses))
            if frame in frames:
                yield result
        yield from _chosen(tracker, carried[path is backward :], frames)


def _chosen(tracker: Tracker, carried: list[Carried], frames: range) -> Iterator[FrameResult]:
    """Yield the frames of one direction whose poses the last one changes."""
    chosen = chosen_sequence(tracker.model, tracker.settings, carried)
    for (result, _), now in zip(carried, chosen, strict=True):
        if now is not result and now.frame in frames:
            yield now
