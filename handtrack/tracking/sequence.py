"""Frame after frame, forward from the first pose and backward before it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from handtrack.arrays import Floats
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation
from handtrack.tracking.frame.appearance_terms import Before
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.tracker import Tracker

Observe = Callable[[int, BonePoses | None], Observation]
"""what is seen of a frame; the hand's bones where it is expected tell which points of a cloud are the hand's,
None where that is not known"""

_REMEMBERED = 30  # results that a step may look back on


def track_frames(
    tracker: Tracker,
    observe: Observe,
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
    seen_first = observe(start_frame, tracker.model.bones(start_params))
    first = tracker.step(seen_first, (), start_params, should_stop)
    if _stopped(should_stop):
        return
    if start_frame in frames:
        yield first
    params = tracker.model.transform.solver_params(first.parameters)
    given = Before(seen_first, tracker.model.bones(params))
    forward = range(start_frame + 1, frames.stop)
    backward = range(start_frame - 1, frames.start - 1, -1)
    for path in (forward, backward):
        history, before = [first], seen_first
        for frame in path:
            seen = observe(frame, tracker.expected_bones(frame, history[-_REMEMBERED:]))
            result = tracker.step(
                seen, history[-_REMEMBERED:], None, should_stop, before=before, given=given
            )
            if _stopped(should_stop):
                return
            history = [*history[-_REMEMBERED:], result]
            before = before if result.status == Status.LOST else seen
            if frame in frames:
                yield result


def _stopped(should_stop: Callable[[], bool] | None) -> bool:
    return should_stop is not None and should_stop()
