"""Frame after frame, forward from the first pose and backward before it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from handtrack.arrays import Floats
from handtrack.observation.observation import Observation
from handtrack.tracker.result import FrameResult
from handtrack.tracker.tracker import Tracker

_REMEMBERED = 30  # results that a step may look back on


def track_frames(
    tracker: Tracker,
    observe: Callable[[int], Observation],
    start_frame: int,
    start_params: Floats,
    frames: range,
    should_stop: Callable[[], bool] | None = None,
) -> Iterator[FrameResult]:
    """Yield a result for every frame of `frames`, in the order of tracking.

    The start frame comes first, then the later ones, then the earlier ones backward from it. When the start
    lies outside `frames`, it is still solved there first, so that the path to the range is tracked, but only
    the range is yielded. A step cut short by `should_stop` is not yielded.
    """
    first = tracker.step(observe(start_frame), (), start_params, should_stop)
    if _stopped(should_stop):
        return
    if start_frame in frames:
        yield first
    forward = range(start_frame + 1, frames.stop)
    backward = range(start_frame - 1, frames.start - 1, -1)
    for path in (forward, backward):
        history = [first]
        for frame in path:
            result = tracker.step(observe(frame), history[-_REMEMBERED:], None, should_stop)
            if _stopped(should_stop):
                return
            history = [*history[-_REMEMBERED:], result]
            if frame in frames:
                yield result


def _stopped(should_stop: Callable[[], bool] | None) -> bool:
    return should_stop is not None and should_stop()
