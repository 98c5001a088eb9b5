"""Job control: starts, follows and ends background jobs, one at a time, and says how they went."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from handtrack.arrays import Floats, S
from handtrack.detector.weights import DOWNLOAD_MB, fetch_weights
from handtrack.errors import HandtrackError, not_enough_memory
from handtrack.session.doctor.check_hand import odd_side
from handtrack.session.first_pose import FirstPose
from handtrack.session.first_pose_search import find_first_poses
from handtrack.session.run import TrackingRun
from handtrack.session.session_state import (
    NOTHING,
    DecidedPose,
    Edit,
    SessionState,
    StartPose,
    decide,
    in_turn,
)
from handtrack.session.track_session import (
    Ended,
    FramesRefined,
    PassBegan,
    SizeFitted,
    TrackingRequest,
    decided_frames,
    refine_frames,
    track_session,
)
from handtrack.store.history import NOTE
from handtrack.tracking.find_pose import PoseEstimate
from handtrack.tracking.frame.confidence import OutlineFit, hand_words
from handtrack.tracking.frame.control import Control, Observer
from handtrack.tracking.frame.result import FrameHead, FrameResult, Status
from handtrack.tracking.whole.refinement import Refinement
from handtrack_app.engine import edits
from handtrack_app.engine.compile_watch import CompileWatch
from handtrack_app.engine.document import Document, moved_mm
from handtrack_app.engine.document_snapshots import timeline_change
from handtrack_app.engine.live_control import LiveControl
from handtrack_app.engine.opening import nothing_observed
from handtrack_app.engine.persistence import FIXED
from handtrack_app.engine.service import BackgroundJob, Service, Work
from handtrack_app.protocol import (
    Command,
    Guess,
    GuessesSnapshot,
    Notice,
    ProgressSnapshot,
)

if TYPE_CHECKING:
    from handtrack_app.engine.open_session import OpenSession


def tracking_request(
    document: Document, frames: range, first: int, anew: bool = False, both_ends: bool = False
) -> TrackingRequest:
    """Return the request to track frames from the pose at `first`, by all that was decided; a single frame by nothing else.

    anew: tracking starts at `first` by itself, so a keyframe there is only a start; see Document.start_pose.
    """
    run, start = document.run, document.start_pose(first, anew)
    if len(frames) == 1:
        return TrackingRequest(frames, first, start, fit_size=False, track_again=False)
    results, accepted = document.results, document.accepted
    poses = {f: pose for f, pose in document.by_hand.items() if f in frames}
    tracked = {f: results[f] for f in accepted - poses.keys() if f in frames and f in results}
    fixed, guides = decided_frames(run, document.state, poses, tracked)
    if anew and first not in accepted:
        fixed.pop(first, None)
        guides.pop(first, None)
    return TrackingRequest(
        frames,
        first,
        start,
        fixed,
        guides,
        both_ends,
        fit_size=document.size.pending,
        track_again=anew,  # else other takes are of the model that there is
    )


def changed_frames(before: SessionState, now: SessionState) -> list[int] | None:
    """Return at which frames keyframes or pins are new or moved; None where none is, where one was let go, or anything else may have
    changed that frames are refined with.
    """
    found = set[int]()
    for was, held in ((_keyframes(before), _keyframes(now)), (before.pins, now.pins)):
        if was.keys() - held.keys():
            return None
        found |= {frame for frame, value in held.items() if was.get(frame) != value}
    kinds = {kind for kind, _ in now.changed(before)}
    return None if kinds - {"pose", "pins", "accepted"} else sorted(found) or None


def _keyframes(state: SessionState) -> dict[int, DecidedPose]:
    return {f: pose for f, pose in state.pose.items() if not (pose.carried or pose.is_led)}


_OTHER_ARM = "Masks of all frames show another forearm than those of the first."
_VISIBLE_MM = 5.0  # a joint's move that one sees: half a finger's breadth


_NO_RESULT = {
    "hand": "No searched frame has a hand that silhouettes or clouds identify with confidence. Try a frame in which the "
    "hand is open and entirely in view, or pose it yourself.",
    "body": "No searched frame has a body that its joints identify with confidence. Try a frame in which it is entirely in view, or "
    "pose it yourself.",
}


def search_notice(candidates: Sequence[PoseEstimate], kind: str) -> Notice:
    """Return what a search for a hand or a body found."""
    if not candidates:
        return Notice("warning", f"No {kind} found", _NO_RESULT[kind])
    best, more = candidates[0], len(candidates) - 1
    text = f"Frame {best.frame}, {100 * best.confidence:.0f} % sure: {best.note}."
    if more:
        text += f" {more} other {'pose is' if more == 1 else 'poses are'} in the tab Pose and in the scene; a click takes one."
    return Notice("done", f"The {kind} is found", text)


def one_frame(result: FrameResult, fit: OutlineFit | None) -> Notice:
    """Return how fitting one frame went. fit: to its silhouettes, where there are some."""
    if result.status == Status.TRACKED:
        words = "The pose explains what was observed." if fit is None else fit.words
        return Notice("done", f"Frame {result.frame} is fitted", words)
    if result.fits:
        return Notice(
            "warning",
            f"Frame {result.frame} fits, with low confidence",
            f"{result.note[:1].upper()}{result.note[1:]}.",
        )
    text = result.note or "The pose does not explain the observations"
    return Notice(
        "warning", f"Frame {result.frame} does not fit well", f"{text}. Undo brings your pose back."
    )


def summary(results: Sequence[FrameHead], total: int, by_hand: int, seconds: float) -> str:
    """Return how a run of tracking went, in one sentence or two.

    total: frames that were to be tracked. by_hand: frames that stayed as they were given.
    """
    done, statuses = len(results), [result.status for result in results]
    reasons = [result.reason for result in results if result.reason is not None]
    poor = [reason for reason in reasons if reason.kind == "poor cloud"]
    odd = {
        "with low confidence": statuses.count(Status.DOUBTFUL),
        "lost": statuses.count(Status.LOST),
        "with a poor cloud": len(poor),
        "with the fingers fixed, because the cloud is too poor": sum(bool(r.part) for r in poor),
    }
    quality = ", ".join(f"{count} {words}" for words, count in odd.items() if count)
    hand = f" {by_hand} set by hand or detected are unchanged." if by_hand > 1 else ""
    if by_hand == 1:
        hand = " One, set by hand or detected, is unchanged."
    speed = f"{1000 * seconds / max(done, 1):.0f} ms a frame"
    return f"{done} of {total} frames in {seconds:.1f} s ({speed}); {quality or 'none with low confidence'}.{hand}"


def size_words(run: TrackingRun) -> str:
    """Return how fitting the size went."""
    known = hand_words(run.model).removeprefix("hand ")
    return f"The {run.model.kind} is {run.scale.overall:.2f} times an adult's mean{known and f': {known}'}."


def moved_words(moves: Mapping[int, float]) -> str:
    """Return what refining changed, in a sentence; empty where nothing was refined. moves: of each frame's furthest joint [mm]."""
    if not moves:
        return ""
    far = {frame: most for frame, most in moves.items() if most > _VISIBLE_MM}
    if not far:
        return f"Refined together; no joint moved by more than {_VISIBLE_MM:g} mm."
    worst = max(far, key=lambda frame: far[frame])
    have = "frame has" if len(far) == 1 else "frames have"
    return (
        f"Refined together; {len(far)} {have} a joint that moved by more than {_VISIBLE_MM:g} mm, most in frame {worst} "
        f"({far[worst]:.0f} mm)."
    )


_SHOW_EVERY_S = 0.05  # while tracking, poses are shown at most this often
_STRIP_EVERY_S = 0.25  # and the timeline is redrawn
_ENDLESS = 1 << 40  # frames
_TOGETHER = 100  # refined frames that are handed over at once
_WORDS = {
    "paused": "Paused",
    "tracking": "Tracking",
    "preparing": "Preparing the first frame …",
    "sizing": "Fitting the size (once a session) …",
    "finding": "Looking for it in the images …",
    "carrying": "Propagating corrected masks …",
    "refining": "Refining all frames together …",
}


class JobControl(Service):
    """Lives on the worker's thread; only what stops or holds a job may come from others."""

    def __init__(
        self,
        opened: OpenSession,
        watch: Callable[[TrackingRun, FrameResult], None],
        compiles: CompileWatch,
        live: LiveControl | None,
    ) -> None:
        """watch: sees the run and each tracked frame, on the job's thread."""
        self.follows = True
        """each tracked frame is shown"""
        super().__init__(opened)
        self._live, self._watch = live, watch
        self._job: BackgroundJob | None = None
        self._moves: dict[int, float] = {}
        self._given = self.document.state
        """when the pass began"""
        self._refined_with: SessionState | None = None
        """what held when frames were refined last, with what that changed"""
        self._stood: tuple[int, Floats[S]] | None = None
        """frame and pose shown before those that were tracked to fit the size"""
        self._shown = self._stripped = 0.0
        self._compiles = compiles
        self._compiled_before = 0
        self._told: ProgressSnapshot | None = None
        self.guesses = Guesses(self.document)

    @property
    def busy(self) -> bool:
        return self._job is not None

    def require_idle(self) -> None:
        """Raise HandtrackError while a job runs."""
        if self.busy:
            raise HandtrackError(FIXED)

    # ---- from any thread

    def cancel(self) -> None:
        """Ask the job to stop at its next solver step."""
        if (job := self._job) is not None:
            job.cancel()

    def set_following(self, on: bool) -> None:
        """Show each frame as it is tracked, or not."""
        self.follows = on

    def stop_following(self, **_: object) -> None:
        """Show tracked frames no more as they come: somebody looks at a frame."""
        self.follows = False

    def give_way(self, **_: object) -> None:
        """Let the job wait a moment, too: somebody drags, which calls twenty times a second."""
        self.follows = False
        if (job := self._job) is not None:
            job.give_way()

    def pause(self, on: bool) -> None:
        """Hold the job, or let it go on."""
        if (job := self._job) is not None:
            job.pause(on)

    def stop(self, timeout: float) -> None:
        """End the job and wait for it."""
        if (job := self._job) is not None:
            job.cancel()
            job.join(timeout)

    def leave(self) -> None:
        """Do not wait for a cancelled job that looks up too rarely: what it still reports is passed over."""
        job = self._job
        if job is not None and (job.stage == "size" or job.kind != "tracking"):
            job.cancel()
            self._ended(job, True, None)

    # ---- starting

    @Command(job=True)
    def track(
        self,
        start: int,
        stop: int,
        first: int,
        anew: bool = False,
        version: int = 0,
        both_ends: bool = False,
    ) -> None:
        """Track frames [start, stop) from the pose at `first` (shown there, set or tracked). A hand's size that is still to be fitted
        comes first.

        anew: start from the first-frame pose as saved, even if its frame was tracked before. version: of the user's edits, when
        fitting one frame is one. both_ends: between keyframes half of the frames are tracked from each.
        """
        document = self.document
        self._prepare()
        if stop - start == 1 and document.frame == first:
            self.see_arm()
        document.see_frames()
        frames = range(max(start, document.frames.start), min(stop, document.frames.stop))
        if not frames or first not in document.frames:
            raise HandtrackError(
                f"No frames to track: {start} to {stop} of a session with frames "
                f"{document.frames.start} to {document.frames.stop - 1}."
            )
        if document.size.live is not None and anew and not document.by_hand:
            self.store.do("Size as before refining", edits.size(document.size.live))
        if len(frames) == 1:
            document.refuse_to_fit(frames.start)
        later = document.run.settings.model.fit_size == "later"
        if document.size.pending and not later and len(frames) > 1:
            document.begin_at(first)
        request = tracking_request(document, frames, first, anew, both_ends)
        sizes = request.fit_size and (later or document.run.first is not None)
        self._track(replace(request, fit_size=sizes))

    def _track(self, request: TrackingRequest) -> None:
        run = self.document.run
        work = partial(self._work_at_tracking, run=run, request=request)
        self.begin("tracking", work, request, run.session.live is not None)

    def _work_at_tracking(
        self, job: BackgroundJob, run: TrackingRun, request: TrackingRequest
    ) -> None:
        control = Control(job.should_stop, _Following(self, job), waits=not job.is_live)
        for event in track_session(run, request, control):
            if job.stage:
                job.begin_stage()
            match event:
                case FrameResult():
                    job.report(self.take_frame, event)
                    self._watch(run, event)
                case PassBegan():
                    run = event.run
                    job.report(self._pass_began, job, event)
                    if not job.is_live:
                        job.total = sum(len(frames) for *_, frames in event.segments)
                case FramesRefined():
                    self._report_refined(job, event)
                case SizeFitted():
                    job.report(self._sized, event)
                case str():
                    job.report(self._warn, event)
                case Ended():
                    if event.problem:
                        raise HandtrackError(event.problem)

    def _report_refined(self, job: BackgroundJob, refined: FramesRefined) -> None:
        """Hand refined frames over in parts, so that the worker serves edits in between."""
        for first in range(0, len(refined.results), _TOGETHER):
            some = refined.results[first : first + _TOGETHER]
            job.report(self._refined, job, some, refined.refinement)

    @Command(job=True)
    def refine(self) -> None:
        """Optimise the tracked frames jointly; keyframes stay fixed. Where nothing but keyframes and pins has changed since, those
        that they touch.
        """
        self._prepare()
        document = self.document
        request = tracking_request(document, document.frames, document.first_frame)
        tracked = [document.results[f] for f in document.results if f not in request.fixed]
        if len(tracked) < 2:
            raise HandtrackError("There is nothing to refine: track some frames first.")
        before = self._refined_with
        changed = None if before is None else changed_frames(before, document.state)
        run, found = document.run, document.results.refinement
        if changed is not None and found is not None:
            run = replace(run, cameras=Refinement.read(found).cameras)

        def work(job: BackgroundJob) -> None:
            control = Control(job.should_stop, job)
            result = refine_frames(run, request, tracked, control, changed)
            self._report_refined(job, result)
            for words in [] if result.refinement is None else result.refinement.words:
                job.report(self._warn, words)

        self.begin("refining", work, request)

    @Command(job=True)
    def track_live(self) -> None:
        """Track what the cameras show from now on, from the pose shown, until it is cancelled."""
        self._prepare()
        self.see_arm()
        document, feed = self.document, self.document.run.session.live
        if feed is None:
            raise HandtrackError("This is a recording, and no live source: track its frames.")
        feed.begin_counting()
        first = feed.known.stop
        endless = range(first, first + _ENDLESS)
        self._track(TrackingRequest(endless, first, document.shown, fit_size=False))

    @Command(job=True, files=True)
    def fit_size(self) -> None:
        """Fit the hand's size to the frames near the first pose."""
        self._prepare()
        run = self.document.run
        if run.first is None:
            raise HandtrackError(
                "The size is fitted from the first-frame pose on, and this session has none yet. Find or pose it, "
                "and press 'Save as first-frame pose'."
            )

        def work(job: BackgroundJob) -> None:
            result = run.fit_size(Control(job.should_stop, job))
            if not job.should_stop():
                job.report(self._sized, SizeFitted(result))

        self.begin("sizing", work)

    @Command(job=True)
    def find_hand(self, frame: int | None, fetch: bool = False) -> None:
        """Detect the hand without a first pose, in one frame, or in the surest of several (None). fetch: get the detector's networks
        before.
        """
        self._prepare()
        run = self.document.run

        def work(job: BackgroundJob) -> None:
            show = partial(job.progress, stage="")
            if fetch:
                show(0.0, f"Fetching the hand detector, {DOWNLOAD_MB} MB")
                try:
                    fetch_weights(job.should_stop)
                except HandtrackError:
                    if job.should_stop():
                        return
                    raise
            result = find_first_poses(run, frame, job.should_stop, show)
            if not job.should_stop():
                job.report(self._finish_search, result)
                for words in odd_side(FirstPose.of(result[0]), run.session) if result else ():
                    job.report(self._warn, words)

        self.begin("finding", work)

    @Command(view=True, latest=(), at_once="set_following")
    def follow(self, on: bool) -> None:
        """Whether each frame is shown as it is tracked."""

    def see_arm(self) -> None:
        """Give the model a forearm where the frame shown has one; never under a job, as what it solves for would change."""
        document, arm = self.document, NOTHING
        if not self.busy:
            params = document.model.params_within_limits(document.shown)
            arm = edits.arm(document, document.run.with_arm_in_view(document.frame, params).arm_m)
        if self.store.do("Forearm in view", arm, kind=NOTE):
            self.opened.show_session()
            self.opened.show_all()

    def _prepare(self) -> None:
        """Write what was edited, before a job. Raises HandtrackError where none can begin."""
        self.store.write_what_rests(at_once=True)
        if self.busy:
            raise HandtrackError("Tracking is already running. Cancel it first.")
        blind = nothing_observed(self.document.run)
        if blind:
            raise HandtrackError(blind)

    def begin(
        self,
        kind: str,
        work: Work,
        request: TrackingRequest | None = None,
        is_live: bool = False,
    ) -> None:
        """Begin a job, while no other runs."""

        def guarded(job: BackgroundJob) -> None:
            problem = None
            try:
                work(job)
            except MemoryError as error:
                problem = not_enough_memory(kind.capitalize(), error)
            except Exception as error:
                problem = error
            job.report(self._ended, job, job.cancelled, problem)

        job = BackgroundJob(kind, guarded, self._post, request, is_live)
        self._job, self._moves, self._given = job, {}, self.document.state
        self._compiled_before = self._compiles.count
        job.start()
        self.show_progress()

    # ---- following

    def _post(self, job: BackgroundJob, take: Callable[[], None]) -> None:
        self.opened.post(partial(self._take, job, take))

    def _take(self, job: BackgroundJob, take: Callable[[], None]) -> None:
        """Take what the job reports; what an earlier job does is passed over."""
        if job is not self._job:
            return
        try:
            take()
        except Exception:
            self.show_progress()  # a full disk at a job's end: it is over all the same
            raise

    def _warn(self, words: str) -> None:
        self.publish(Notice.about_recording(words))

    def _pass_began(self, job: BackgroundJob, began: PassBegan) -> None:
        """Begin a take; it is of the size that may just have been found."""
        self.store.end_take(finished=False)
        self._moves, self._given = {}, self.document.state
        first, params, _ = began.segments[0]
        try:
            self.store.begin_take(began.frames, first, params, _fixed(job))
        except HandtrackError:
            job.cancel()
            raise
        for result in began.resumed:
            self.store.add(result)

    def try_frame(self, result: FrameResult) -> None:
        """Show a frame that is tracked to fit the size."""
        document = self.document
        if self._follows_now():
            self._stood = self._stood or (document.frame, document.shown)
            document.show(result.frame)
            document.shown = result.parameters
            self.opened.show_pose()

    def _show_what_stood(self) -> None:
        """Show no pose of a trial any more, as no frame keeps one; nor the trial's frame, unless somebody has gone to another."""
        stood, self._stood, document = self._stood, None, self.document
        if stood is not None:
            frame, document.shown = stood
            document.show(frame if self.follows else document.frame)

    def _follows_now(self) -> bool:
        """Whether a pose is to be shown as it comes: now and then, if that is wanted."""
        now = time.monotonic()
        is_due = self.follows and now - self._shown > _SHOW_EVERY_S
        self._shown = now if is_due else self._shown
        return is_due

    def take_frame(self, result: FrameResult) -> None:
        """Keep a frame as it is tracked, and show it now and then."""
        document, now = self.document, time.monotonic()
        document.see_frames()
        if not self.store.add(result):
            return
        if self._live is not None:
            self._live.note(result)
        if self._follows_now():
            document.show(result.frame)
            self.opened.show_pose()
        if now - self._stripped > _STRIP_EVERY_S:
            self._stripped = now
            self.publish(timeline_change(document))
        self.show_progress()

    def _refined(
        self, job: BackgroundJob, results: Sequence[FrameResult], refinement: Refinement | None
    ) -> None:
        """Lay refined frames over those that were tracked, as a take of their own."""
        document = self.document
        if not self._moves:
            frames, first = document.frames, document.first_frame
            self.store.end_take(finished=True)
            params = document.start_params(first, anew=True)
            self.store.begin_take(frames, first, params, _fixed(job), True, refinement)
        for result in results:
            self._moves[result.frame] = moved_mm(result, document.results.get(result.frame))
            self.store.add(result)
        given = self._given
        self._refined_with = replace(document.state, pose=given.pose, pins=given.pins)
        self.opened.record_again(results)
        self.publish(timeline_change(document))

    def _sized(self, event: SizeFitted) -> None:
        document, run = self.document, event.run
        self._show_what_stood()
        is_arm = event.after_tracking and run.arm_m != document.run.arm_m
        self.store.do("Size", in_turn(edits.size(run.scale), edits.arm(document, run.arm_m)))
        self.opened.show_session()
        self.opened.show_pose()
        words = _OTHER_ARM if is_arm else size_words(document.run)
        self.publish(Notice("done", "Tracking again" if is_arm else "Size fitted", words))

    def _finish_search(self, candidates: list[PoseEstimate]) -> None:
        if candidates:
            self.guesses.keep(candidates)
            self.document.show(candidates[0].frame)
            snapshot = self.guesses.snapshot(is_new=True)
            self.opened.show_pose()
            if snapshot is not None:
                self.publish(snapshot)
        self.publish(search_notice(candidates, self.document.model.kind))

    def _ended(self, job: BackgroundJob, cancelled: bool, problem: Exception | None) -> None:
        self._job = None
        document = self.document
        self._show_what_stood()
        document.show(document.frame)
        self.opened.show_all()
        if job.kind == "tracking" or self._moves:
            self.store.end_take(finished=not (cancelled or problem))
        said = self._end_words(job, cancelled, problem)
        if said is not None:
            self.publish(said)
        self.show_progress()

    def _end_words(
        self, job: BackgroundJob, is_cancelled: bool, problem: Exception | None
    ) -> Notice | None:
        """Return how a job went; None where there is nothing to say."""
        document, live, known = self.document, self._live, self.document.results
        cancelled = Notice("done", "Cancelled", "") if is_cancelled else None
        if problem is not None:
            title = "Not propagated" if job.kind == "carrying" else "Tracking stopped"
            return Notice.of_error(problem, title)
        if job.kind == "refining":
            return cancelled or Notice("done", "Refined", moved_words(self._moves))
        if job.kind != "tracking" or (cancelled and not job.done and live is None):
            return cancelled
        if live is not None and job.total == 0:
            return Notice("done", "Tracking ended", " ".join(live.count_words()))
        one = known.get(job.frames.start) if len(job.frames) == 1 else None
        if one is not None and not cancelled:
            params = document.model.transform.solver_params(one.parameters)
            return one_frame(one, document.run.fit_of(one.frame, params)[1])
        heads = [head for frame in job.solved if (head := known.head(frame)) is not None]
        text = summary(heads, job.total, len(job.frames) - job.total, job.worked_s)
        title = "Cancelled" if cancelled else "Tracking finished"
        return Notice("done", title, f"{text} {moved_words(self._moves)}".rstrip())

    def show_progress(self) -> None:
        """Say what is going on, where that is new; called now and then."""
        now = self._progress()
        if now != self._told:
            self._told = now
            self.publish(now)

    def _progress(self) -> ProgressSnapshot:
        job = self._job
        if job is None:
            return ProgressSnapshot("idle", "Ready")
        state = "paused" if job.paused else "tracking" if job.done else "preparing"
        quiet = not job.paused and (job.kind != "tracking" or bool(job.words))
        words, done, total = _WORDS[job.kind if quiet else state], job.done, job.total
        if state == "preparing" and self._compiles.count > self._compiled_before:
            words = self._compiles.words
        if quiet and job.words:
            words = job.words[:1].upper() + job.words[1:]
            done, total = round(100 * job.share), 100
        elif total and state != "preparing":
            words += f": {done} of {total} frames"
        return ProgressSnapshot(state, words, done, total, round(job.eta_s()), job.kind, job.frame)


class _Following(Observer):
    """Shows how tracking goes on."""

    def __init__(self, jobs: JobControl, job: BackgroundJob) -> None:
        self._jobs, self._job = jobs, job
        self.progress = job.progress

    def provisional(self, result: FrameResult) -> None:
        self._job.count(result.frame)
        self._job.report(self._jobs.take_frame, result)

    def tried(self, result: FrameResult) -> None:
        self._job.report(self._jobs.try_frame, result)


def _fixed(job: BackgroundJob) -> tuple[int, ...]:
    """Return the frames whose poses were fixed."""
    return () if job.request is None else tuple(job.request.fixed)


# ---- The poses that a frame may have: found without a first pose, or carried along by the tracker


_MOST = 8  # of a list


@dataclass
class Guesses:
    """What was found, by frame; what is carried stands in the tracker's results. On the worker's thread only."""

    document: Document
    results: dict[int, list[PoseEstimate]] = field(default_factory=dict)
    """by frame, the surest first"""
    _published: tuple[int, str, int] = (-1, "", 0)

    def keep(self, candidates: list[PoseEstimate]) -> None:
        """Keep what a search found."""
        self.results[candidates[0].frame] = candidates

    def snapshot(self, is_new: bool = False) -> GuessesSnapshot | None:
        """Return the list of the frame shown; None where the page has it already."""
        frame = self.document.frame
        kind, poses = self._poses(frame)
        key = (frame, kind, id(poses[0].params) if poses else 0)
        if key == self._published or (not poses and not self._published[1]):
            return None
        self._published = key
        if not poses:
            return GuessesSnapshot(frame, "")
        bones = [pose.model.bones(pose.params) for pose in poses]
        counts = [len(b.position) for b in bones]
        return GuessesSnapshot(
            frame,
            kind,
            tuple(Guess(pose.confidence, pose.note) for pose in poses),
            np.repeat(np.arange(len(poses)), counts),
            np.concatenate([b.position for b in bones]),
            np.concatenate([b.rotation for b in bones]),
            np.concatenate([pose.model.skeleton.length for pose in poses]),
            is_new,
        )

    def take(self, frame: int, index: int) -> Edit:
        """Return what setting a frame's pose to one of its list changes: the model may get a forearm for it, or a size
        still to be fitted; where the session has no first pose, tracking begins there.
        """
        kind, poses = self._poses(frame)
        if not 0 <= index < len(poses):
            return NOTHING
        document, model = self.document, poses[index].model
        arm = model.has_forearm and not document.model.has_forearm
        arm = arm and document.model.has_keypoints21
        changed = [decide(forearm=np.inf)] if arm else []
        if document.size.pending and model.scale != document.run.scale:
            changed.append(edits.size(model.scale, pending=True))
        known = model.named(model.joint_params(poses[index].params))
        changed.append(decide(pose={frame: DecidedPose(known, found=kind == "found")}))
        if document.run.first is None:
            changed.append(decide(start=StartPose(frame, known)))
        return in_turn(*changed)

    def _poses(self, frame: int) -> tuple[str, list[PoseEstimate]]:
        """Return where the poses of a frame are from, as GuessesSnapshot has it, and the poses."""
        if frame in self.results:
            return "found", self.results[frame][:_MOST]
        result, model = self.document.results.get(frame), self.document.model
        carried = () if result is None else result.alternatives[:_MOST]
        if len(carried) < 2:
            return "", []
        return "carried", [
            PoseEstimate(
                model, model.transform.solver_params(h.parameters), h.energy, confidence=h.weight, frame=frame,
                note=f"{h.origin}, cost {h.energy:.1f}",
            )
            for h in carried
        ]  # fmt: skip
