"""Long work on its own thread: tracking, fitting the size, finding the hand. Posing never waits for a solver step."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from handtrack.detector.weights import DOWNLOAD_MB, fetch_weights
from handtrack.errors import HandtrackError, not_enough_memory
from handtrack.session.doctor.check_hand import odd_side
from handtrack.session.first_pose.first_pose import FirstPose
from handtrack.session.first_pose.first_pose_search import find_first_poses
from handtrack.session.run import TrackingRun
from handtrack.session.session_state import Correction
from handtrack.session.track_session import (
    Ended,
    Event,
    FramesRefined,
    PassBegan,
    SizeFitted,
    TrackingRequest,
    refine_frames,
    track_session,
)
from handtrack.tracking.find_pose import PoseEstimate
from handtrack.tracking.frame.control import Control, Observer
from handtrack.tracking.frame.result import FrameResult

_TOGETHER = 100  # refined frames that are handed over at once


@dataclass(frozen=True)
class JobEnded:
    """The job is over; `problem` says why, if not as asked."""

    cancelled: bool
    problem: Exception | None = None


@dataclass(frozen=True)
class TriedFrame:
    """A frame that is tracked to fit the size: nothing is kept of it."""

    result: FrameResult


FirstPoses = list[PoseEstimate]
"""poses that explain a frame, the most probable first"""
Corrections = dict[tuple[str, int], Correction]
"""of masks, carried to the frames beside: as the session's state has them"""
Work = Callable[["BackgroundJob"], None]
"""does a job; asks its `should_stop` between solver steps"""
JobEvent = Event | TriedFrame | FirstPoses | Corrections | JobEnded
Post = Callable[["BackgroundJob", JobEvent], None]
"""hands something that a job did over to the worker"""
Watch = Callable[[TrackingRun, FrameResult], None]
"""sees the run and each tracked frame, on the job's thread"""


_SIZING = "Fitting the size: "
_REFINING = "Refining all frames together …"
_GIVES_WAY_S = 0.3
"""that a job waits after each place to which somebody moves the hand; a page sends one every 0.05 s, and each is to be answered
before the next"""


class BackgroundJob:
    """Works until done, cancelled, or failed; reports events and at last JobEnded."""

    def __init__(
        self, kind: str, work: Work, post: Post, request: TrackingRequest | None, is_live: bool
    ) -> None:
        """request: of what is tracked or refined. is_live: running cameras do not wait."""
        self.kind, self.request = kind, request
        self.frames = range(0) if request is None else request.frames
        self.total = len(self.frames) if kind == "tracking" and not is_live else 0
        """frames to be done"""
        self.solved: set[int] = set()
        self.frame: int | None = None
        """done last"""
        self.share, self.words, self.stage = 0.0, "", ""
        """of a stage, what is done in it, and its name: `size` or `refine`, or nothing where frames are counted"""
        self._since: tuple[float, float] | None = None
        """when the stage first told a share, and which"""
        self._began = self._held = time.monotonic()
        self._work, self._post, self.is_live = work, post, is_live
        self._stop, self._hold = threading.Event(), threading.Event()
        self._way_until = 0.0
        self._thread = threading.Thread(target=self._work_guarded, name=kind, daemon=True)

    @property
    def done(self) -> int:
        return len(self.solved)

    @property
    def paused(self) -> bool:
        return self._hold.is_set()

    @property
    def worked_s(self) -> float:
        """Seconds since it began, but for those in which it was held."""
        return (self._held if self.paused else time.monotonic()) - self._began

    def start(self) -> None:
        self._thread.start()

    def pause(self, on: bool) -> None:
        """Hold before the next solver step, or go on."""
        if on and not self.paused:
            self._held = time.monotonic()
            self._hold.set()
        elif self.paused and not on:
            self._began += time.monotonic() - self._held
            self._hold.clear()

    def give_way(self) -> None:
        """Wait a moment before the next solver step; not before running cameras."""
        if not self.is_live:
            self._way_until = time.monotonic() + _GIVES_WAY_S

    def cancel(self) -> None:
        """Ask the solver to stop at its next step."""
        self._stop.set()

    def join(self, timeout: float) -> None:
        if self._thread.is_alive():  # else it may not have begun
            self._thread.join(timeout)

    def eta_s(self) -> float:
        """Return the expected seconds left; 0 while unknown. What comes first, and may compile, does not count."""
        then, first = self._since or (0.0, self.share)
        gained = self.share - first
        return (self.worked_s - then) / gained * (1.0 - self.share) if gained > 0 else 0.0

    def should_stop(self) -> bool:
        while self._hold.is_set() or time.monotonic() < self._way_until:
            if self._stop.wait(0.02):
                break
        return self._stop.is_set()

    def report(self, event: JobEvent) -> None:
        """Hand an event over to the worker."""
        self._post(self, event)

    def count(self, frame: int) -> None:
        """A frame is done, perhaps again."""
        self.solved.add(frame)
        self.frame = frame
        if self.total:
            self.show_progress(self.done / self.total)

    def begin_stage(self, stage: str = "") -> None:
        """Begin another stage; the time that is left is that of a stage."""
        self.stage, self.share, self.words, self._since = stage, 0.0, "", None

    def show_progress(self, share: float, words: str = "") -> None:
        """Take how far the stage is: the share that is done, 0 to 1, and what is done in words."""
        if self._since is None:
            self._since = self.worked_s, share
        self.share, self.words = share, words

    def _work_guarded(self) -> None:
        problem = None
        try:
            self._work(self)
        except MemoryError as error:
            problem = not_enough_memory(self.kind.capitalize(), error)
        except Exception as error:
            problem = error
        self.report(JobEnded(self._stop.is_set(), problem))


class _Following(Observer):
    """Shows how a job goes on."""

    def __init__(self, job: BackgroundJob) -> None:
        self._job = job

    def provisional(self, result: FrameResult) -> None:
        self._job.count(result.frame)
        self._job.report(result)

    def tried(self, result: FrameResult) -> None:
        if self._job.kind == "tracking":
            self._job.report(TriedFrame(result))

    def progress(self, share: float, words: str = "", stage: str = "refine") -> None:
        if stage != self._job.stage:
            self._job.begin_stage(stage)
        self._job.show_progress(share, _SIZING + words if stage == "size" else _REFINING)


def track(
    job: BackgroundJob, run: TrackingRun, request: TrackingRequest, watch: Watch | None
) -> None:
    """Track frames (`track_session`)."""

    control = Control(job.should_stop, _Following(job), waits=not job.is_live)
    for event in track_session(run, request, control):
        if job.stage:
            job.begin_stage()
        if isinstance(event, FramesRefined):
            _report_refined(job, event)
            continue
        job.report(event)
        if isinstance(event, PassBegan):
            run = event.run
            if not job.is_live:
                job.total = sum(len(frames) for *_, frames in event.segments)
        elif isinstance(event, FrameResult) and watch is not None:
            watch(run, event)
        elif isinstance(event, Ended) and event.problem:
            raise HandtrackError(event.problem)


def refine(
    job: BackgroundJob,
    run: TrackingRun,
    request: TrackingRequest,
    tracked: Sequence[FrameResult],
    changed: Sequence[int] | None,
) -> None:
    """Refine tracked frames together; where keyframes have changed since, those alone that they affect (`refine_frames`)."""
    control = Control(job.should_stop, _Following(job))
    result = refine_frames(run, request, tracked, control, changed)
    _report_refined(job, result)
    for words in [] if result.refinement is None else result.refinement.words:
        job.report(words)


def _report_refined(job: BackgroundJob, refined: FramesRefined) -> None:
    """Hand refined frames over in parts, so that the worker serves edits in between."""
    for first in range(0, len(refined.results), _TOGETHER):
        job.report(replace(refined, results=refined.results[first : first + _TOGETHER]))


def fit_size(job: BackgroundJob, run: TrackingRun) -> None:
    """Fit the size to the frames near the first pose."""
    result = run.fit_size(Control(job.should_stop, _Following(job)))
    if not job.should_stop():
        job.report(SizeFitted(result))


def find(job: BackgroundJob, run: TrackingRun, frame: int | None, fetch: bool) -> None:
    """Look for the hand without a first pose, in a frame or in the surest of several (None); fetch the detector before if asked to."""
    if fetch:
        job.show_progress(0.0, f"Fetching the hand detector, {DOWNLOAD_MB} MB")
        try:
            fetch_weights(job.should_stop)
        except HandtrackError:
            if job.should_stop():
                return
            raise
    result = find_first_poses(run, frame, job.should_stop, job.show_progress)
    if not job.should_stop():
        job.report(result)
        for words in odd_side(FirstPose.of(result[0]), run.session) if result else ():
            job.report(words)
