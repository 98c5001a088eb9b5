"""Frame after frame, with searches beside: frames go on from the pose that stands, and are solved anew where a search
finds a better one. While searches find better ones, each frame is searched on all cores before the next. What comes out is what
stepping from frame to frame gives, to the byte.
"""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from handtrack.observation.observation import Observation
from handtrack.parallel import thread_count, workers
from handtrack.tracking.frame.constants import FRAMES_AHEAD
from handtrack.tracking.frame.control import Control, Observe, Observer, SearchReport
from handtrack.tracking.frame.frame_task import TrackerState
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.tracker import Tracker

Stepped = tuple[TrackerState, FrameResult]
Searched = tuple[TrackerState, FrameResult, Sequence[SearchReport]]


_SWITCH_S = 0.0005
"""how long the next frame waits for the interpreter while a search holds it; Python's own 5 ms are a tenth of a frame"""

_CAUGHT_UP = 4
"""frames at most that are solved anew before a live camera: all of them would take a second, in which the hand moves on"""


class _Reports(Observer, list[SearchReport]):
    """Searches of a frame."""

    def search(self, report: SearchReport) -> None:
        self.append(report)


@dataclass(eq=False)
class _Frame:
    """A frame that is solved, as long as no search finds a better pose in it or before."""

    number: int
    stepped: Searched | None = None
    """without searches"""
    beside: Future[Searched] | None = None
    """a whole step with its searches, made beside; where the step without any failed, its error, told once the frames before are settled"""
    dropped: threading.Event = field(default_factory=threading.Event)
    """set where nobody waits for it any longer"""


class SpeculativeExecution:
    """Frames on from a state, yielded once settled; `show` is given them as soon as they are solved.

    Whoever watches single solver steps, or has one thread, gets one frame after the other, searches included.
    """

    def __init__(
        self,
        tracker: Tracker,
        observe: Observe,
        state: TrackerState,
        control: Control,
        show: Callable[[FrameResult], None],
    ) -> None:
        self._tracker, self._observe, self._control = tracker, observe, control
        self._show = show
        self._state = state
        self._ahead: deque[_Frame] = deque()  # solved, not yet settled
        self._again: deque[int] = deque()  # to be solved anew
        beside = thread_count() > 1 and control.on_iteration is None
        self._most = FRAMES_AHEAD if beside else 0
        self._reach = self._most  # frames that may go ahead of a search

    def frames(self, numbers: Iterable[int]) -> Iterator[Stepped]:
        """Yield the state after each frame, and its result; ends early when `control.should_stop`."""
        # one core is left to the frames
        pool, patience = workers(max(thread_count() - 1, 1), "search"), sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH_S)
        try:
            yield from self._pursued(iter(numbers), pool)
        finally:
            self._drop(self._ahead)
            pool.shutdown(cancel_futures=True)
            sys.setswitchinterval(patience)

    def _stepped(self, number: int) -> Stepped | None:
        """Return a frame solved with its searches; None when stopped."""
        seen = self._observe(number, self._tracker.expected_bones(self._state, number))
        self._state, result, reports = self._searched(self._state, seen, self._control)
        if self._control.should_stop():
            return None
        if reports:
            self._learn(any(report.winner is not None for report in reports))
        self._show(result)
        self._report(reports)
        return self._state, result

    def _searched(self, before: TrackerState, seen: Observation, control: Control) -> Searched:
        """Return a whole step, with what its searches report."""
        reports = _Reports()
        after, result = self._tracker.step(before, seen, replace(control, observer=reports))
        return after, result, reports

    def _pursued(self, numbers: Iterator[int], pool: ThreadPoolExecutor) -> Iterator[Stepped]:
        while True:
            while self._ahead and self._is_known(self._ahead[0]):
                settled = self._resolved(self._ahead.popleft())
                if settled is None:
                    return
                yield settled
            if self._reach == 0 and not self._ahead:
                number = self._next(numbers)
                stepped = None if number is None else self._stepped(number)
                if stepped is None:
                    return
                yield stepped
                continue
            full = len(self._ahead) > self._reach
            if full and not self._control.waits:
                self._drop([self._ahead[0]])
                self._ahead[0].beside = None  # it stands as it is solved
                continue
            number = None if full else self._next(numbers)
            if number is not None:
                self._go_on(number, pool)
            elif self._ahead:
                if (search := self._ahead[0].beside) is not None:
                    search.exception()
            else:
                return
            if self._control.should_stop():
                return

    def _next(self, numbers: Iterator[int]) -> int | None:
        if self._again:
            return self._again.popleft()
        if self._ahead and self._ahead[-1].stepped is None:
            return None
        return next(numbers, None)

    def _go_on(self, number: int, pool: ThreadPoolExecutor) -> None:
        """Solve a frame without searches; begin beside what is due."""
        frame = _Frame(number)
        self._ahead.append(frame)
        reports, before = _Reports(), self._state
        control = replace(self._control, observer=reports)
        try:
            seen = self._observe(number, self._tracker.expected_bones(before, number))
            after, result, due = self._tracker.step_without_search(before, seen, control)
        except Exception as problem:  # an earlier frame's search may lead elsewhere
            frame.beside = Future()
            frame.beside.set_exception(problem)
            return
        self._state, frame.stepped = after, (after, result, reports)
        if self._control.should_stop():
            return
        if due and (control.waits or not any(other.beside for other in self._ahead)):
            self._search(frame, before, seen, pool)
        self._show(result)

    def _search(
        self, frame: _Frame, before: TrackerState, seen: Observation, pool: ThreadPoolExecutor
    ) -> None:
        asked = self._control.should_stop
        control = replace(self._control, should_stop=lambda: frame.dropped.is_set() or asked())
        frame.beside = pool.submit(self._searched, before, seen, control)

    def _is_known(self, frame: _Frame) -> bool:
        return frame.beside is None or frame.beside.done()

    def _resolved(self, frame: _Frame) -> Stepped | None:
        """Return a frame as it holds, None when stopped. Where it holds otherwise than it stood, those after it are due anew."""
        found_beside = frame.beside and frame.beside.result()
        assert frame.stepped is not None
        after, result, reports = frame.stepped
        if found_beside is not None:
            searched, found, reports = found_beside
            if self._control.should_stop():
                return None
            is_better = _is_changed(result, found)
            self._learn(is_better)
            if is_better:
                after, result = searched, found
                later = [other.number for other in self._ahead]
                if not self._control.waits:
                    later = later[:: -(-len(later) // _CAUGHT_UP) or 1]
                self._again.extendleft(reversed(later))
                self._drop(self._ahead)
                self._ahead.clear()
                self._state = after
                self._show(result)
        self._report(reports)
        return after, result

    def _learn(self, is_better: bool) -> None:
        """Let no frame go ahead after a search that found a better pose, and twice as many after each that found none."""
        if self._control.waits:
            self._reach = 0 if is_better else min(2 * self._reach + 1, self._most)

    def _report(self, reports: Iterable[SearchReport]) -> None:
        for report in reports:
            self._control.observer.search(report)

    @staticmethod
    def _drop(frames: Iterable[_Frame]) -> None:
        for frame in frames:
            if frame.beside is not None:
                frame.dropped.set()
                frame.beside.cancel()


def _is_changed(stood: FrameResult, found: FrameResult) -> bool:
    same = np.array_equal(stood.parameters, found.parameters)
    # reasons as texts: a number that is not known, NaN, is not even equal to itself
    return not same or stood.status != found.status or repr(stood.reason) != repr(found.reason)
