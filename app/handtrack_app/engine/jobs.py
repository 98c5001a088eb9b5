"""Long work on its own thread: tracking, fitting the size, finding the hand. Posing never waits for a solver step."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from handtrack.detector.weights import DOWNLOAD_MB, fetch_weights
from handtrack.errors import HandtrackError, not_enough_memory
from handtrack.session.first_pose.first_pose_candidate import FirstPoseCandidate
from handtrack.session.first_pose.first_pose_search import find_first_poses
from handtrack.session.run import TrackingRun
from handtrack.session.session_state import Correction
from handtrack.session.track_session import (
    Ended,
    Event,
    FramesRefined,
    FrameTracked,
    PassBegan,
    Progress,
    ProvisionalFrame,
    SizeFitted,
    TrackingRequest,
    Warned,
    refine_frames,
    track_session,
)
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import FrameResult

log = logging.getLogger(__name__)

_TOGETHER = 100  # refined frames that are handed over at once


@dataclass(frozen=True)
class JobEnded:
    """The job is over; `error` says why, if not as asked."""

    cancelled: bool
    error: str = ""
    internal: bool = False


@dataclass(frozen=True, eq=False)
class Tried:
    """A frame was tracked to fit the size; nothing is kept of it."""

    result: FrameResult


@dataclass(frozen=True)
class Found:
    """Poses that explain a frame, the most probable first."""

    candidates: list[FirstPoseCandidate]


@dataclass(frozen=True)
class Carried:
    """Corrections of masks, carried to the frames beside."""

    corrections: dict[tuple[str, int], Correction]
    """of the session's state"""


@dataclass(frozen=True, eq=False)
class Report:
    """Something that a job did."""

    job: int
    event: Event | ProvisionalFrame | Tried | Found | Carried | JobEnded


Watch = Callable[[TrackingRun, FrameResult], None]
"""sees the run and each tracked frame, on the job's thread"""


_SIZING = "Fitting the size: "
_REFINING = "Refining all frames together …"
_GIVES_WAY_S = 0.3
"""that a job waits after each place to which somebody moves the hand; a page sends one every 0.05 s, and each is to be answered
before the next"""


class BackgroundJob:
    """Works until done, cancelled, or failed; posts reports and at last JobEnded."""

    kind = "job"

    def __init__(self, number: int, frames: range, post: Callable[[Report], None]) -> None:
        self.number, self.frames = number, frames
        self.total = len(frames)
        """frames to be done"""
        self.done, self.began, self.waited = 0, time.monotonic(), 0.0
        self._held = self.began
        self.frame: int | None = None
        """done last"""
        self.share, self.words = 0.0, ""
        """of a stage that counts no frames, and what is done in it"""
        self._first_done, self._first_share = self.began, 0.0
        self._post = post
        self._stop, self._hold = threading.Event(), threading.Event()
        self._way_until = 0.0
        self._thread = threading.Thread(target=self._work_guarded, name=self.kind, daemon=True)

    @property
    def paused(self) -> bool:
        return self._hold.is_set()

    def start(self) -> None:
        self._thread.start()

    def pause(self, on: bool) -> None:
        """Hold before the next solver step, or go on."""
        if on and not self.paused:
            self._held = time.monotonic()
        elif self.paused and not on:
            self.waited += time.monotonic() - self._held
        (self._hold.set if on else self._hold.clear)()

    def give_way(self) -> None:
        """Wait a moment before the next solver step."""
        self._way_until = time.monotonic() + _GIVES_WAY_S

    def cancel(self) -> None:
        """Ask the solver to stop at its next step."""
        self._stop.set()

    def join(self, timeout: float) -> None:
        if self._thread.is_alive():  # else it may not have begun
            self._thread.join(timeout)

    def eta_s(self) -> float:
        """Return the expected seconds left; 0 while unknown. The first frame, which may compile, does not count."""
        if not self.total and not self.share:
            return 0.0
        spent = time.monotonic() - self._first_done - self.waited
        if self.share > self._first_share:
            return spent / (self.share - self._first_share) * (1.0 - self.share)
        if self.done < 2:
            return 0.0
        return spent / (self.done - 1) * (self.total - self.done)

    def work(self) -> None:
        """Do it; ask `should_stop` between solver steps."""
        raise NotImplementedError

    def should_stop(self) -> bool:
        while self._waits() and not self._stop.wait(0.02):
            pass
        return self._stop.is_set()

    def _waits(self) -> bool:
        return self._hold.is_set() or time.monotonic() < self._way_until

    def report(self, event: Event | ProvisionalFrame | Tried | Found | Carried | JobEnded) -> None:
        """Hand an event over to the worker."""
        self._post(Report(self.number, event))

    def show_progress(self, share: float, words: str) -> None:
        """Take how far the work is: the share that is done, 0 to 1, and what is done in words."""
        if not self.share:
            self._first_done, self._first_share, self.waited = time.monotonic(), share, 0.0
        self.share, self.words = share, words

    def _work_guarded(self) -> None:
        error, internal = "", False
        try:
            self.work()
        except HandtrackError as problem:
            error = str(problem)
        except MemoryError as problem:
            error = str(not_enough_memory(self.kind.capitalize(), problem))
        except Exception as problem:  # reported to the user: the page must go on
            log.exception("%s failed", self.kind)
            error, internal = f"{type(problem).__name__}: {problem}", True
        self.report(JobEnded(self._stop.is_set(), error, internal))


class TrackingJob(BackgroundJob):
    """Tracks frames (`track_session`)."""

    kind = "tracking"

    def __init__(
        self,
        number: int,
        run: TrackingRun,
        request: TrackingRequest,
        post: Callable[[Report], None],
        watch: Watch | None = None,
    ) -> None:
        super().__init__(number, request.frames, post)
        self._run, self.request, self._watch = run, request, watch
        self._is_live = run.session.live is not None
        self.total = 0 if self._is_live else len(request.frames)
        self.stage = ""
        """`size` or `refine` where no frames are tracked"""
        self._solved: set[int] = set()

    def give_way(self) -> None:
        """Wait a moment; not before running cameras, which do not wait either."""
        if not self._is_live:
            super().give_way()

    def work(self) -> None:
        control = Control(self.should_stop, waits=not self._is_live)
        for event in track_session(self._run, self.request, control, self._progressed):
            self.stage, self.words, self.share = "", "", 0.0
            if isinstance(event, FramesRefined):
                report_refined(self, event)
                continue
            self.report(event)
            if isinstance(event, PassBegan):
                self._run = event.run
                if not self._is_live:
                    self.total = sum(len(segment.frames) for segment in event.segments)
            elif isinstance(event, FrameTracked) and self._watch is not None:
                self._watch(self._run, event.result)
            elif isinstance(event, Ended) and event.problem:
                raise HandtrackError(event.problem)

    def _progressed(self, now: Progress | ProvisionalFrame) -> None:
        if isinstance(now, Progress):
            if now.stage != self.stage:
                self.stage, self.share = now.stage, 0.0
            if now.stage == "refine":
                self.show_progress(now.share, _REFINING)
                return
            self.show_progress(now.share, _SIZING + now.message)
            if now.tracked is not None:
                self.report(Tried(now.tracked))
            return
        self._solved.add(now.result.frame)  # frames may come again
        self.done, self.frame = len(self._solved), now.result.frame
        if self.done == 1:
            self._first_done, self.waited = time.monotonic(), 0.0
        self.report(now)


class RefiningJob(BackgroundJob):
    """Refines tracked frames together; where keyframes have changed since, those alone that they affect (`refine_frames`)."""

    kind = "refining"

    def __init__(
        self,
        number: int,
        run: TrackingRun,
        request: TrackingRequest,
        tracked: Sequence[FrameResult],
        changed: Sequence[int] | None,
        post: Callable[[Report], None],
    ) -> None:
        super().__init__(number, range(0), post)
        self._run, self.request, self._tracked, self._changed = run, request, tracked, changed

    def work(self) -> None:
        control, tracked = Control(self.should_stop), self._tracked
        found = refine_frames(
            self._run, self.request, tracked, control, self._progressed, self._changed
        )
        report_refined(self, found)
        for words in [] if found.refinement is None else found.refinement.words:
            self.report(Warned(words))

    def _progressed(self, now: Progress | ProvisionalFrame) -> None:
        if isinstance(now, Progress):
            self.show_progress(now.share, _REFINING)


def report_refined(job: BackgroundJob, refined: FramesRefined) -> None:
    """Hand refined frames over in parts, so that the worker serves edits in between."""
    for first in range(0, len(refined.results), _TOGETHER):
        job.report(replace(refined, results=refined.results[first : first + _TOGETHER]))


class SizingJob(BackgroundJob):
    """Fits the size to the frames near the first pose."""

    kind = "sizing"

    def __init__(self, number: int, run: TrackingRun, post: Callable[[Report], None]) -> None:
        super().__init__(number, range(0), post)
        self._run = run

    def work(self) -> None:
        found = self._run.fit_size(
            self.should_stop,
            tell=lambda share, words, _=None: self.show_progress(share, _SIZING + words),
        )
        if not self.should_stop():
            self.report(SizeFitted(found))


class FindingJob(BackgroundJob):
    """Looks for the hand without a first pose, in a frame or in the surest of several (None); fetches the detector before if asked to."""

    kind = "finding"

    def __init__(
        self,
        number: int,
        run: TrackingRun,
        frame: int | None,
        fetch: bool,
        post: Callable[[Report], None],
    ) -> None:
        super().__init__(number, range(0), post)
        self._run, self._frame, self._fetch = run, frame, fetch

    def work(self) -> None:
        if self._fetch:
            self.show_progress(0.0, f"Fetching the hand detector, {DOWNLOAD_MB} MB")
            try:
                fetch_weights(self.should_stop)
            except HandtrackError:
                if self.should_stop():
                    return
                raise
        found = find_first_poses(self._run, self._frame, self.should_stop, self.show_progress)
        if not self.should_stop():
            self.report(Found(found))
