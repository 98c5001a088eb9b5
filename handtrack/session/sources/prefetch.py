"""What the next frame needs of files is read while this one is solved."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager

from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation
from handtrack.parallel import thread_count
from handtrack.tracking.frame.control import Observe


@contextmanager
def prefetching(
    observe: Observe, prepare: Callable[[int], object], frames: range, start: int
) -> Iterator[Observe]:
    """Yield `observe`, with the frame after the one asked for prepared beside: decoded, segmented, undistorted, measured.

    What is prepared stays in the session's own memory, so nothing differs but when the work is done; a frame that cannot
    be read says so when it is asked for. start: of `frames`, where tracking begins: forward from there, and backward before it.
    """
    if thread_count() == 1:
        yield observe
        return
    begun: dict[int, Future[object]] = {}
    beside = ThreadPoolExecutor(1, "look-ahead")

    def look(frame: int, bones: BonePoses | None) -> Observation:
        if frame in begun:
            begun[frame].exception()  # waits; what failed is tried, and told of, below
        seen = observe(frame, bones)
        then = frame + (1 if frame >= start else -1)
        if then in frames:
            begun.clear()
            begun[then] = beside.submit(prepare, then)
        return seen

    try:
        yield look
    finally:
        beside.shutdown(cancel_futures=True)
