"""What the next frame needs of files is read while this one is solved."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation
from handtrack.parallel import thread_count


class Prefetch:
    """`observe`, with the frame after the one asked for prepared beside: decoded, segmented, undistorted, measured.

    What is prepared stays in the session's own memory, so nothing differs but when the work is done; a frame that cannot
    be read says so when it is asked for.
    """

    def __init__(
        self,
        observe: Callable[[int, BonePoses | None], Observation],
        prepare: Callable[[int], object],
        frames: range,
        start: int,
    ) -> None:
        """start: of `frames`, where tracking begins: forward from there, and backward before it."""
        self._observe, self._prepare, self._frames, self._start = observe, prepare, frames, start
        self._beside = ThreadPoolExecutor(1, "look-ahead") if thread_count() > 1 else None
        self._next: tuple[int, Future[object]] | None = None

    def __call__(self, frame: int, bones: BonePoses | None) -> Observation:
        """Return what is seen of a frame; see tracking.sequence.Observe."""
        if self._next is not None and self._next[0] == frame:
            self._next[1].exception()  # waits; what failed is tried, and told of, below
        seen = self._observe(frame, bones)
        way = 1 if frame >= self._start else -1
        if self._beside is not None and frame + way in self._frames:
            self._next = frame + way, self._beside.submit(self._prepare, frame + way)
        return seen

    def close(self) -> None:
        """Drop what is not begun, wait for what is."""
        if self._beside is not None:
            self._beside.shutdown(cancel_futures=True)
