"""An open session: its document, files, jobs and pictures, and what each command of the page does to them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace

from handtrack.errors import HandtrackError
from handtrack.session.doctor.check_hand import inconsistency_of_cameras
from handtrack.session.session import frames_words
from handtrack.session.session_state import Edit
from handtrack.store.history import Action
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine import edits
from handtrack_app.engine.camera_pictures import Painter
from handtrack_app.engine.cloud_service import CloudService
from handtrack_app.engine.compile_watch import CompileWatch
from handtrack_app.engine.document import Document
from handtrack_app.engine.document_snapshots import (
    observed_kinds,
    pose_snapshot,
    session_snapshot,
    timeline_snapshot,
)
from handtrack_app.engine.job_control import JobControl
from handtrack_app.engine.live_control import KEEPS_NOTHING, LiveControl
from handtrack_app.engine.mask_service import MaskService
from handtrack_app.engine.opening import NO_POSE, nothing_observed
from handtrack_app.engine.persistence import Persistence, export_beside
from handtrack_app.engine.posing_service import LiveScore, PosingService
from handtrack_app.engine.review_service import ReviewService
from handtrack_app.engine.service import RenderThread
from handtrack_app.engine.tuning_service import TuningService
from handtrack_app.process.child import EnginePlan
from handtrack_app.protocol import (
    Call,
    Command,
    Notice,
    Snapshot,
    WorkSnapshot,
    commands_of,
)
from handtrack_app.rerun_recorder import LiveRecorder

_UNFIT = ("overlap", "out of view", "part outside", "beside")
"""reasons for which a pose is asked about before it is a first pose"""
_STEPS = 20  # of the history that are named on the page
_LIVE = (
    "The cameras' newest images are shown; posing the hand halts them, 'Follow' in the tab Track goes on. Press 'Detect "
    "hand', or pose it, then 'Track live'."
)


class OpenSession:
    """Lives on the worker's thread."""

    def __init__(
        self,
        document: Document,
        publish: Callable[[Snapshot], None],
        post: Callable[[Callable[[], None]], None],
        render_thread: RenderThread,
        recorder: LiveRecorder,
        compiles: CompileWatch,
        plan: EnginePlan,
    ) -> None:
        """post: has something done on the worker's thread, in its turn."""
        self.document = document
        self._recorder = recorder
        self._unrecorded: list[int] = []
        """tracked frames that rerun is still to be shown"""
        self._asked_to_save: tuple[int, bytes] | None = None
        self.store = Persistence.open(document, plan.take_over)
        restored = self.store.restore()
        known, page = self.store.history.said, plan.page
        self._restored = restored if known else ""
        """what comes back of the user's own work; of what the terminal or an import made nobody is told"""
        self._page = page
        self._served = self._written = known[1] if page and known and known[0] == page else 0
        is_live = document.session.live is not None
        self._live = LiveControl(document, publish) if is_live else None
        self.publish = publish
        self.painter = Painter(document, publish, render_thread)
        self.render_thread, self.post = render_thread, post
        self.jobs = JobControl(self, recorder.show, compiles, self._live)
        self._clouds = CloudService(self)
        self._tuning, self._review = TuningService(self), ReviewService(self)
        self._pictures = (self.painter, self._clouds)
        parts = (
            self,
            self.jobs,
            PosingService(self),
            self._tuning,
            self._review,
            self.painter,
            self._clouds,
            MaskService(self),
        )
        self._commands = {
            name: getattr(part, name) for part in parts for name in commands_of(type(part))
        }
        self._score = LiveScore(document, publish)
        self._counted, self._reported = False, set[str]()
        self._reported_work: WorkSnapshot | None = None

    def show_first(self) -> None:
        """Show the session and its first pose, and say what is to be known of it."""
        document, notify = self.document, self._notify
        self._publish_work()
        self.show_session()
        document.show(document.first_frame)
        self.show_all()
        if self._restored:
            notify("done", "Welcome back", self._restored)
        blind = nothing_observed(document.run)
        if blind:
            notify("warning", "Nothing to track by yet", blind)
        elif self._live is not None:
            notify("guide", "Live", _LIVE)
        elif not document.is_posed:
            notify("guide", "No first pose yet", NO_POSE[document.model.kind])
        self._notify_warnings(self.store.warning)
        self._tuning.publish_notes()
        self.jobs.show_progress()
        self._compare_cameras()

    def _compare_cameras(self) -> None:
        """Warn of a camera that contradicts the others in what was tracked before; found on the render thread."""
        results, run = self.document.some_results(), self.document.run

        def look() -> Notice | None:
            text = inconsistency_of_cameras(run, results)
            return Notice.about_recording(text) if text else None

        self.render_thread.ask("cameras", look)

    # ---- commands

    def serve(self, call: Call) -> None:
        """Do what is asked. Raises HandtrackError for what cannot be done."""
        if call.number:
            self.store.said = (self._page, call.number)
        try:
            if self._live is not None and call.command.files:
                raise HandtrackError(KEEPS_NOTHING)
            arguments, document = dict(call.arguments), self.document
            if arguments.get("frame") is not None:  # of the page, which may know others
                arguments["frame"] = document.clamped(arguments["frame"])
            document.version = max(document.version, arguments.get("version", 0))
            with self.changing() if call.command.tunes else nullcontext():
                self._commands[call.name](**arguments)
        finally:
            self._served = call.number or self._served

    @Command(latest=(), is_ordered=True, at_once="stop_following")
    def show_frame(self, frame: int, is_played: bool = False) -> None:
        """Show another frame. is_played: it is sent with all its pictures at one time; of a frame that somebody went to, they come
        later.
        """
        if self.store.write_what_rests(at_once=True):
            self.show_timeline()
        self.document.show(frame)
        self.show_pose(is_played)

    @Command(edits=True, at_once="stop_following")
    def undo(self, version: int) -> None:
        """Take the latest step back: a pose, a setting, limits, filters, a size, a take."""
        self._travel(self.store.undo, "Undone", "Nothing to undo")

    @Command(edits=True, at_once="stop_following")
    def redo(self, version: int) -> None:
        """Make the step again that was undone last."""
        self._travel(self.store.redo, "Redone", "Nothing to redo")

    @Command(edits=True)
    def restore_take(self, number: int) -> None:
        """Make a take the current track."""
        again = edits.restored(self.document, number)
        if self._lay(f"Take {number} restored", again):
            self._notify("done", f"Take {number} is the track again", "")

    @Command(edits=True)
    def show_take(self, number: int) -> None:
        """Use the model that a take was tracked with, so that its frames show; the track stays composed as it is."""
        self._lay(f"Model of take {number}", edits.model_of_take(self.document, number))

    def _lay(self, words: str, edit: Edit) -> bool:
        """Make an edit of what is shown of the takes, perhaps of another model; return whether that changed anything."""
        self.jobs.require_idle()
        changed = self.store.do(words, edit)
        if changed:
            self.show_session()
            self.document.show(self.document.frame)
            self.show_all()
        return changed

    @Command(job=True)
    def record(self, on: bool, folder: str | None = None) -> None:
        """Record what the cameras show and what is tracked to a new session folder (None: beside the session's), or end that."""
        if self._live is not None:
            self._live.record(on, folder)

    @Command(at_once="pause")
    def pause(self, on: bool) -> None:
        """Hold tracking before its next frame, or go on."""
        self.jobs.show_progress()

    @Command(at_once="cancel")
    def cancel(self) -> None:
        """Stop tracking now; frames tracked so far stay."""
        self._tuning.cancel()
        self.jobs.leave()  # most jobs report their end themselves

    @Command(job=True)
    def open_rerun(self) -> None:
        """Record for rerun the frames that are tracked, the one shown first, and those that will be; RerunPage says where it is."""
        shown, known = self.document.frame, self.document.results
        if not len(known):
            self._notify(
                "info",
                "Rerun waits for frames",
                "Residuals come with the next frame that is tracked.",
            )
        self._unrecorded = sorted(known, key=lambda frame: (frame != shown, frame), reverse=True)
        self._recorder.open()

    def record_again(self, results: Sequence[FrameResult]) -> None:
        """Record refined frames for rerun before those that wait, if any are."""
        if self._recorder.is_on:
            self._unrecorded[:0] = [result.frame for result in reversed(results)]

    @Command(edits=True, files=True)
    def save_pose(self) -> None:
        """Write the pose shown to init.json."""
        self.jobs.see_arm()
        warning = self._pose_warning()
        if warning:
            self._notify("warning", "Not saved yet", warning)
        else:
            self._notify("done", "First-frame pose saved", self.store.save_first_pose())

    @Command(edits=True, files=True)
    def save_track(self) -> None:
        """Write tracks/poses.npz."""
        self._notify("done", "Track saved", self.store.save_track())

    @Command(job=True)
    def export(self, kind: str, client_id: int, up: str = "") -> None:
        """Send a file to one client: in a format of `handtrack export --to`, or `init`, the pose that is shown. up: which of the world's
        axes points up, for formats whose readers take one for it; empty: nothing is turned.
        """
        export_beside(self.document, kind, client_id, up, self.publish)

    @Command(edits=True, at_once="stop_following")
    def take_guess(self, frame: int, index: int, version: int) -> None:
        """Set the pose of a frame to one of the list."""
        taken = self.jobs.guesses.take(frame, index)
        model = self.document.model
        self.edit(frame, taken, "Detected pose")
        if self.document.model is not model:
            self.show_session()
            self.show_all()

    def _pose_warning(self) -> str:
        """Return why the pose shown should not be a first pose, and that saving it once more takes it; empty where nothing speaks
        against it, or it was asked already.
        """
        document = self.document
        shown = (document.frame, document.shown.tobytes())
        params = document.model.transform.solver_params(document.shown)
        reason, _ = document.run.fit_of(document.frame, params)
        if reason is None or reason.kind not in _UNFIT or shown == self._asked_to_save:
            return ""
        self._asked_to_save = shown
        return (
            f"Frame {document.frame}: {reason.words}. Tracking would start from this pose. Fit it to the images, or save it once more "
            "to take it as it is."
        )

    def _travel(self, travel: Callable[[bool], Action | None], done: str, end: str) -> None:
        """Undo or redo, and show what that changed."""
        known, before = self.document.run.notes, self.document.state
        try:
            action = travel(self.jobs.busy)
        except HandtrackError:
            self.show_pose()  # of this version: the page's widgets wait for it
            raise
        if action is None:
            self.show_pose()
            self._notify("info", end, "The history of edits ends here.")
            return
        changed = self.document.state.changed(before)
        frames = [frame for kind, frame in changed if kind == "pose"]
        self.document.show(min(frames, default=self.document.frame))
        self._notify("done", f"{done}: {action.words[:1].lower()}{action.words[1:]}", "")
        if len(frames) < len(changed):
            self.show_session()
            self._tuning.publish_notes(known)
        self.show_all()

    @contextmanager
    def changing(self, is_stroke: bool = False) -> Iterator[None]:
        """A block that changes what is tracked by, saves or restores it: what holds then is shown, and the frame shown follows if that is
        wanted. is_stroke: it is one of many that change no setting. Raises HandtrackError while a job runs.
        """
        document, run = self.document, self.document.run
        known = observed_kinds(document.session)
        try:
            self.jobs.require_idle()
            yield
            if document.run is not run:
                self._tuning.fit_again()
        finally:
            if not is_stroke or observed_kinds(document.session) != known:
                self.show_session()
            (self.show_pose if is_stroke else self.show_all)()

    def _notify_warnings(self, *more: str) -> None:
        for warning in filter(None, (*more, *self.document.session.warnings)):
            if warning not in self._reported:
                self._reported.add(warning)
                self._notify("warning", "About this session", warning)

    # ---- edits

    def edit(
        self,
        frame: int,
        edit: Edit,
        words: str,
        tag: str = "",
        is_stroke: bool = False,
    ) -> None:
        """Change a pose, and show it. It is written when edits rest. words: what is done, for undo."""
        try:
            done = f"{words}, frame {frame}"
            self.store.do(done, edit, tag, waits=True, is_stroke=is_stroke)
        finally:
            self.document.show(frame)
            self.show_pose()

    def write_what_rests(self) -> None:
        """Write edits once none came for a while; what fails is told, and tried again with the next."""
        try:
            if self.store.write_what_rests():
                self.show_timeline()
        finally:
            self._publish_work()

    def _publish_work(self) -> None:
        """Say what is on disk, where that changed."""
        if not self.store.has_edits_to_write:
            self._written = self._served
        document, names = self.document, self.store.history.names(_STEPS)
        takes = document.takes.cards(document.results)
        now = WorkSnapshot(self.store.saved, takes, self._written, self._served, *names)
        if now != self._reported_work:
            self._reported_work = now
            self.publish(now)

    # ---- showing

    def _notify(self, level: str, title: str, text: str) -> None:
        self.publish(Notice(level, title, text))

    def show_session(self) -> None:
        """Publish what is open."""
        self.publish(session_snapshot(self.document))

    def show_pose(self, is_played: bool = False) -> None:
        """Publish the pose, and have its pictures made; of a frame that is played, with them."""
        pose = pose_snapshot(self.document)
        if is_played:
            made = self.painter.picture()
            pose = replace(pose, beside=() if made is None else (made,))
        self.publish(pose)
        self._score.since = time.monotonic()
        guesses = self.jobs.guesses.snapshot()
        if guesses is not None:
            self.publish(guesses)
        for shown in (self._clouds,) if is_played else self._pictures:
            shown.show_soon()

    def show_timeline(self) -> None:
        """Publish the whole recording, and the curves that are looked at."""
        self.publish(timeline_snapshot(self.document))
        if self._review.names:
            self._review.publish_curves()

    def show_all(self) -> None:
        self.show_pose()
        self.show_timeline()

    @property
    def rest_s(self) -> float:
        """How long the worker may wait for a command before there is something to do."""
        if self._live is not None and self._live.recording:
            return 0.0
        return min(0.1, *(one.rest_s(self.jobs.busy) for one in self._pictures))

    def idle(self) -> None:
        """Do what waits while no command does."""
        if self._live is not None:
            self._watch_live(self._live)
        elif not self._counted and self.document.session.is_counted:
            self._take_count()
        if due := [one for one in self._pictures if not one.rest_s(self.jobs.busy)]:
            for shown in due:
                shown.show(hurried=self.jobs.busy)
        elif self._score.is_due and not self.jobs.busy:
            self._score.report()
        elif self._unrecorded and not self._recorder.is_behind:
            frame = self._unrecorded.pop()
            if frame in self.document.results:
                self._recorder.show(self.document.run, self.document.results[frame])
        elif not self.document.rows.is_whole:  # of a long track, while nobody waits
            if not self.document.rows.read_more(self.document):
                self.show_timeline()
        else:
            self.jobs.show_progress()

    def close(self) -> list[str]:
        """Keep the last edits and end what runs; return what is to be said at the end."""
        self._tuning.close()
        said = [] if self._live is None else self._live.close()
        try:
            self.store.close()
        finally:
            self._publish_work()
        return said

    def _watch_live(self, live: LiveControl) -> None:
        """Show the newest images while nothing is tracked and nobody poses the hand in one of them."""
        if live.report() and not self.jobs.busy:
            self.show_timeline()
        follow = self.jobs.follows
        if not self.jobs.busy and (follow or live.recording) and live.watch(follow) and follow:
            self.show_pose()

    def _take_count(self) -> None:
        """Go by the videos' true frames, now that they are counted, and say what is odd about them."""
        document, self._counted = self.document, True
        if document.see_frames():
            document.show(document.frame)
            self.show_session()
            self.show_all()
        self._notify_warnings()
        if document.first_frame not in document.frames:
            raise HandtrackError(
                f"The first-frame pose is of frame {document.first_frame}, but {frames_words(document.frames)}. "
                f"Pose the {document.model.kind} in one of these, and save the first-frame pose anew."
            )


COMMANDS = commands_of(
    OpenSession,
    JobControl,
    PosingService,
    TuningService,
    ReviewService,
    Painter,
    CloudService,
    MaskService,
)
"""what the page can call"""
