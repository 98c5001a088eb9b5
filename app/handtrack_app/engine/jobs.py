"""Long work on its own thread: tracking, fitting the size, finding the hand. Posing never waits for a solver step."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

from handtrack.detector.weights import DOWNLOAD_MB, fetch_weights
from handtrack.errors import HandtrackError, not_enough_memory
from handtrack.model.articulated import HandScale
from handtrack.session.doctor.check_tracked import doubt_of_cameras
from handtrack.session.first_pose.first_pose_candidate import FirstPoseCandidate
from handtrack.session.first_pose.first_pose_search import find_first_poses
from handtrack.session.run import TrackingRun
from handtrack.store.history import Value
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.whole.refinement import Refinement
from handtrack_app.engine.posing.given import Given
from handtrack_app.engine.posing.legs import Leg
from handtrack_app.engine.run import Run

log = logging.getLogger(__name__)

_KEPT = 64  # tracked frames, at most, by which cameras are judged
_TOGETHER = 100  # refined frames that are handed over at once


@dataclass(frozen=True)
class Tracked:
    """A frame is solved, or its result is settled: the same result again, or a better one."""

    job: int
    result: FrameResult


@dataclass(frozen=True)
class Sized:
    """The hand's size is found, and its forearm."""

    job: int
    scale: HandScale
    arm: bool | float
    """see TrackingRun.arm"""


@dataclass(frozen=True)
class Refined:
    """Some of the frames, ascending, refined together with all others."""

    job: int
    results: list[FrameResult]
    shared: Refinement | None = None
    """what they share; the hand's size, where it was found anew with them"""


@dataclass(frozen=True)
class Ended:
    """The job is over; `error` says why, if not as asked."""

    job: int
    cancelled: bool
    error: str = ""
    internal: bool = False


@dataclass(frozen=True)
class Found:
    """Poses that explain a frame, the surest first."""

    job: int
    candidates: list[FirstPoseCandidate]


@dataclass(frozen=True)
class Questioned:
    """A camera that the others contradict by what was tracked, in words."""

    job: int
    text: str


@dataclass(frozen=True)
class Carried:
    """Corrections of masks, carried to the frames beside."""

    job: int
    values: dict[str, Value]
    """of the session's state"""


Report = Tracked | Refined | Sized | Found | Questioned | Carried | Ended
Watch = Callable[[Run, FrameResult], None]
"""sees the run and each tracked frame, on the job's thread"""


_GIVES_WAY_S = 0.3
"""that a job waits after each place to which somebody moves the hand; a page sends one every 0.05 s, and each is to be answered
before the next"""


class BackgroundJob:
    """Works until done, cancelled, or failed; posts reports and at last Ended."""

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
        """of all the work, and what is done now; for jobs that do not count frames"""
        self._first_done, self._first_share = self.began, 0.0
        self.post = post
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

    def tell(self, share: float, words: str) -> None:
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
        self.post(Ended(self.number, self._stop.is_set(), error, internal))


class TrackingJob(BackgroundJob):
    """Tracks frames in legs, each from a pose of its own."""

    kind = "tracking"

    def __init__(
        self,
        number: int,
        run: Run,
        frames: range,
        path: Sequence[Leg],
        post: Callable[[Report], None],
        watch: Watch | None = None,
        given: Given | None = None,
    ) -> None:
        super().__init__(number, frames, post)
        self._run, self._path, self._watch, self.given = run, path, watch, given or Given()
        self.total = 0 if run.session.live is not None else sum(len(leg.frames) for leg in path)
        self._solved: set[int] = set()
        self._some: list[FrameResult] = []

    def give_way(self) -> None:
        """Wait a moment; not before running cameras, which do not wait either."""
        if self._run.session.live is None:
            super().give_way()

    def work(self) -> None:
        run = self._run
        recorded = run.session.live is None
        control = Control(self.should_stop, on_early=self._early, waits=recorded, refines=False)
        refines, found = (
            run.settings.refines and recorded and self.total > 1,
            dict[int, FrameResult](),
        )
        for leg in self._path:
            self.share = 0.0
            for result in run.track_with(control, leg.frames, leg.first, leg.params):
                self.post(Tracked(self.number, result))
                if refines:
                    found[result.frame] = result
                self._some = [*self._some, result] if len(self._some) < _KEPT else self._some[::2]
                if self._watch is not None:
                    self._watch(run, result)
                if self.should_stop():
                    return
            if self.should_stop():
                return
        tracked = [found[frame] for frame in sorted(found)]
        told = refines and refine(self, run, tracked, self.given)
        if (
            recorded
            and not told
            and isinstance(run, TrackingRun)
            and (text := doubt_of_cameras(run, self._some))
        ):
            self.post(Questioned(self.number, text))

    def _early(self, result: FrameResult) -> None:
        self._solved.add(result.frame)  # frames may come again
        self.done, self.frame = len(self._solved), result.frame
        if self.done == 1:
            self._first_done, self.waited = time.monotonic(), 0.0
        self.post(Tracked(self.number, result))


class RefiningJob(BackgroundJob):
    """Refines tracked frames together; where keyframes have changed since, those alone that they touch."""

    kind = "refining"

    def __init__(
        self,
        number: int,
        run: Run,
        tracked: Sequence[FrameResult],
        given: Given,
        changed: Sequence[int] | None,
        post: Callable[[Report], None],
    ) -> None:
        """tracked: ascending; changed: at which frames what was given is new since they were refined, or let go; None: all
        frames are to be refined.
        """
        super().__init__(number, range(0), post)
        self._run, self._tracked, self.given, self._changed = run, tracked, given, changed

    def work(self) -> None:
        refine(self, self._run, self._tracked, self.given, self._changed)


def refine(
    job: BackgroundJob,
    run: Run,
    tracked: Sequence[FrameResult],
    given: Given,
    changed: Sequence[int] | None = None,
) -> bool:
    """Refine frames on a job's thread, and post those that are not as they were; return whether a camera was found to be off,
    which is posted, too.
    """
    shared: list[Refinement] = []
    control = Control(
        job.should_stop,
        on_refined=lambda share: job.tell(share, "Refining all frames together …"),
        on_shared=lambda text: shared.append(Refinement.read(text)),
    )
    before = {result.frame: result for result in tracked}
    results = run.refined(tracked, control, given.held, changed, given.led)
    results = [result for result in results if result is not before.get(result.frame)]
    for first in range(0, len(results), _TOGETHER):
        found = shared[-1] if shared else None
        job.post(Refined(job.number, results[first : first + _TOGETHER], found))
    told = [words for found in shared for words in found.words]
    for words in told:
        job.post(Questioned(job.number, words))
    return bool(told)


class SizingJob(BackgroundJob):
    """Fits the hand's size to frames that are tracked, or to those near the first pose (None), which it tracks."""

    kind = "sizing"

    def __init__(
        self,
        number: int,
        run: Run,
        post: Callable[[Report], None],
        tracked: Sequence[FrameResult] | None = None,
    ) -> None:
        super().__init__(number, range(0), post)
        self._run, self._tracked = run, tracked
        self.is_late = tracked is not None
        """the frames were tracked with the size of before"""

    def work(self) -> None:
        found = self._run.fit_size(self.should_stop, tell=self._tell, tracked=self._tracked)
        if not self.should_stop():
            self.post(Sized(self.number, found.scale, found.arm))

    def _tell(self, share: float, words: str) -> None:
        self.tell(share, f"Fitting the size: {words}")


class FindingJob(BackgroundJob):
    """Looks for the hand without a first pose, in a frame or in the surest of several (None); fetches the detector before if asked to."""

    kind = "finding"

    def __init__(
        self,
        number: int,
        run: Run,
        frame: int | None,
        fetch: bool,
        post: Callable[[Report], None],
    ) -> None:
        super().__init__(number, range(0), post)
        self._run, self._frame, self._fetch = run, frame, fetch

    def work(self) -> None:
        if self._fetch:
            self.tell(0.0, f"Fetching the hand detector, {DOWNLOAD_MB} MB")
            try:
                fetch_weights(self.should_stop)
            except HandtrackError:
                if self.should_stop():
                    return
                raise
        run = cast(TrackingRun, self._run)  # only a session of files can be searched
        found = find_first_poses(run, self._frame, self.should_stop, self.tell)
        if not self.should_stop():
            self.post(Found(self.number, found))
