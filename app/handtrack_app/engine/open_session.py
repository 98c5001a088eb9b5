"""An open session: its document, files, jobs and pictures, and what each command of the page does to them."""

from __future__ import annotations

from collections.abc import Callable, Sequence, Sized
from dataclasses import replace

from handtrack.errors import HandtrackError
from handtrack.store.history import NOTE
from handtrack_app.engine.compile_watch import CompileWatch
from handtrack_app.engine.document import Document
from handtrack_app.engine.document_snapshots import (
    pose_snapshot,
    read_more,
    seen_kinds,
    session_snapshot,
    timeline_snapshot,
    work_snapshot,
)
from handtrack_app.engine.job_control import JobControl
from handtrack_app.engine.jobs import Report, Watch
from handtrack_app.engine.live.live_control import KEEPS_NOTHING, LiveControl
from handtrack_app.engine.masks.mask_service import MaskChange, MaskService
from handtrack_app.engine.opening import NO_POSE, nothing_seen
from handtrack_app.engine.pictures.cloud_service import CloudChange, CloudService
from handtrack_app.engine.pictures.painter import Painter
from handtrack_app.engine.pictures.render_thread import RenderThread
from handtrack_app.engine.posing.pose_service import PoseService
from handtrack_app.engine.posing.pose_service import Request as PoseRequest
from handtrack_app.engine.review.live_score import LiveScore
from handtrack_app.engine.review.review_service import Request as ReviewRequest
from handtrack_app.engine.review.review_service import ReviewService
from handtrack_app.engine.store import edits, keys, saving
from handtrack_app.engine.store.exporting import export_beside
from handtrack_app.engine.store.persistence import Persistence
from handtrack_app.engine.tuning.refit import Refitted
from handtrack_app.engine.tuning.tuning_service import Request as TuningRequest
from handtrack_app.engine.tuning.tuning_service import TuningService
from handtrack_app.protocol import commands, posing
from handtrack_app.protocol.snapshots import (
    Notice,
    PoseSnapshot,
    Snapshot,
    WorkSnapshot,
)

Request = commands.Command | Report | Refitted
_EDITS = (
    posing.TakePose | posing.PullPlace | posing.SetPin | posing.DropPins | posing.CopyPins | posing.ForgetPose
    | commands.Track | commands.TakeGuess | commands.Undo | commands.Redo
)  # fmt: skip
_KEEPS = (
    commands.SavePose
    | commands.SaveTrack
    | commands.SaveSettings
    | commands.SaveClouds
    | commands.SaveMasks
    | commands.PaintMask
    | commands.CarryMasks
    | commands.DropCorrection
    | commands.FitSize
    | commands.TakeSize
)
_UNFIT = ("overlap", "out of view", "part outside", "beside")
"""reasons for which a pose is asked about before it is a first pose"""
_LIVE = (
    "The cameras' newest images are shown; posing the hand halts them, 'Follow' in the tab Track goes on. Press 'Find the "
    "hand', or pose it, then 'Track live'."
)


class OpenSession:
    """Lives on the worker's thread."""

    def __init__(
        self,
        document: Document,
        publish: Callable[[Snapshot], None],
        post: Callable[[Report | Refitted], None],
        waiting: Sized,
        render_thread: RenderThread,
        watch: Watch | None,
        compiles: CompileWatch,
        take_over: bool = False,
        page: str = "",
    ) -> None:
        """post: takes the jobs' reports to `serve`. waiting: what is to be served; painting gives way to it. take_over:
        write, even if another program does. page: whose numbers its commands have.
        """
        self.document = document
        self._asked_to_save: tuple[int, bytes] | None = None
        self.store = Persistence.open(document, take_over)
        self._restored = self.store.restore()
        known, self._page = self.store.history.said, page
        self._served = self._written = known[1] if page and known and known[0] == page else 0
        self._live = LiveControl.of(document, publish)
        self._publish = publish
        self.painter = Painter(document, publish, waiting)
        self.jobs = JobControl(
            document, self.store, self._announce, post, watch, compiles, self._live
        )
        self._clouds = CloudService(document, self.store, self.jobs, render_thread, publish)
        self._masks = MaskService(document, self.store, self.jobs, render_thread, publish)
        self._poses = PoseService(
            document, lambda: self.store.history, self._edit, publish, self._show_pose
        )
        self._tuning = TuningService(
            document, self.store, self.jobs, self._edit, publish, self._show_all, post
        )
        self._review = ReviewService(document, self.store, publish)
        self._score = LiveScore(document, publish)
        self._counted, self._told = False, set[str]()
        self._told_work: WorkSnapshot | None = None

    def show_first(self, wishes: Sequence[commands.Command]) -> None:
        """Show the session and its first pose, and say what is to be known of it."""
        document, say = self.document, self._say
        self._tell_work()
        self._show_session()
        self._clouds.tell()
        self._masks.tell()
        document.show(document.first_frame)
        for wish in wishes:
            self.serve(wish)
        self._show_all()
        if self._restored:
            say("info", "Welcome back", self._restored)
        blind = nothing_seen(document.run)
        if blind:
            say("warning", "Nothing to track by yet", blind)
        elif self._live is not None:
            say("guide", "Live", _LIVE)
        elif not document.is_posed:
            say("guide", "No first pose yet", NO_POSE[document.model.kind])
        self._say_warnings(self.store.warning)
        self._tuning.say_notes(document.run.session.warnings)
        self.jobs.show_progress()

    # ---- commands, and reports of the jobs

    def serve(self, request: Request | commands.Numbered) -> None:
        """Do what is asked. Raises HandtrackError for what cannot be done."""
        if isinstance(request, commands.Numbered):
            self.store.said = (self._page, request.number)
            try:
                self.serve(request.command)
            finally:
                self._served = request.number
            return
        document = self.document
        if self._live is not None and isinstance(request, _KEEPS):
            raise HandtrackError(KEEPS_NOTHING)
        if isinstance(request, _EDITS):
            document.version = max(document.version, request.version)
        if isinstance(request, PoseRequest):
            self._poses.serve(request)
        elif isinstance(request, TuningRequest):
            self._tuning.serve(request)
        elif isinstance(request, ReviewRequest):
            self._review.serve(request)
        elif isinstance(request, CloudChange | MaskChange):
            self._see_otherwise(request)
        elif isinstance(request, Report):
            self._take(request)
        else:
            self._serve(request)

    def _take(self, report: Report) -> None:
        try:
            self.jobs.take(report)
        except Exception:
            self.jobs.show_progress()  # a full disk at a job's end: it is over all the same
            raise

    def _serve(self, request: commands.Command) -> None:
        document, jobs = self.document, self.jobs
        match request:
            case commands.ShowFrame():
                if self.store.write_what_rests(at_once=True):
                    self._announce(timeline_snapshot(document))
                document.show(request.frame)
                self._show_pose(request.is_played)
            case commands.Undo() | commands.Redo():
                self._travel(request)
            case commands.RestoreTake():
                self.jobs.require_idle()
                frames = request.span and range(request.span[0], request.span[1] + 1)
                if self.store.restore_take(request.number, frames):
                    self._show_session()  # it may be of another model
                    document.show(document.frame)
                    self._show_all()
                    self._say("done", f"Take {request.number} is the track again", "")
            case commands.ShowTake():
                self.jobs.require_idle()
                if self.store.show_take(request.number):
                    self._show_session()
                    document.show(document.frame)
                    self._show_all()
            case commands.WantPictures():
                self.painter.want(request)
                self._masks.want(request)
            case commands.Track():
                self.store.write_what_rests(at_once=True)
                if request.stop - request.start == 1 and document.frame == request.first:
                    self._see_arm()
                jobs.track(request)
            case commands.Refine():
                self.store.write_what_rests(at_once=True)
                jobs.refine()
            case commands.TrackLive():
                self.store.write_what_rests(at_once=True)
                self._see_arm()
                jobs.track_live()
            case commands.Record():
                if self._live is not None:
                    self._live.record(request.on, request.folder)
            case commands.FitSize():
                jobs.fit_size()
            case commands.TakeSize():
                self.store.write_what_rests(at_once=True)
                jobs.take_size(request.first)
            case commands.Pause():
                jobs.show_progress()
            case commands.Cancel():
                self._tuning.cancel()
                jobs.leave()  # acted on in `send` already; most jobs report their end themselves
            case commands.Follow() | commands.StartAgain():
                pass  # acted on in `send`
            case commands.WantCloud() | commands.WantSurface():
                self._clouds.want(request)
            case commands.WantMasks():
                self._masks.want(request)
            case commands.SavePose():
                self._see_arm()
                doubt = self._doubt_of_pose()
                if doubt:
                    self._say("warning", "Not saved yet", doubt)
                else:
                    said = saving.save_first_pose(self.store)
                    self._say("done", "First-frame pose saved", said)
            case commands.SaveTrack():
                self._say("done", "Track saved", saving.save_track(self.store))
            case commands.Export():
                export_beside(document, request, self._publish)
            case commands.FindHand():
                self.store.write_what_rests(at_once=True)
                jobs.find(request)
            case commands.TakeGuess():
                taken = jobs.guesses.take(request.frame, request.index)
                self._edit(request.frame, taken, "Detected pose")
                if keys.FOREARM in taken or keys.SIZE in taken:
                    self._show_session()
                    self._show_all()

    def _doubt_of_pose(self) -> str:
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

    def _travel(self, way: commands.Undo | commands.Redo) -> None:
        """Undo or redo, and show what that changed."""
        back, store = isinstance(way, commands.Undo), self.store
        known = self.document.run.notes
        try:
            action = (store.undo if back else store.redo)(self.jobs.busy)
        except HandtrackError:
            self._show_pose()  # of this version: the page's widgets wait for it
            raise
        if action is None:
            self._show_pose()
            end = "Nothing to undo" if back else "Nothing to redo"
            self._say("info", end, "The history of edits ends here.")
            return
        kinds = {keys.parts(change.key) for change in action.changes}
        frames = [int(name) for kind, name in kinds if kind == keys.POSE]
        self.document.show(min(frames, default=self.document.frame))
        done = f"{action.words[:1].lower()}{action.words[1:]}"
        self._say("info", f"{'Undone' if back else 'Redone'}: {done}", "")
        if len(frames) < len(kinds):
            self._show_session()
            self._clouds.tell()
            self._masks.tell()
            self._tuning.say_notes(known)
        self._show_all()

    def _see_otherwise(self, change: CloudChange | MaskChange) -> None:
        """Change clouds or masks; the page learns where there are some for the first time, or none any more."""
        known = seen_kinds(self.document.run.session)
        if isinstance(change, CloudChange):
            self._tuning.followed(lambda: self._clouds.serve(change))
        else:
            self._tuning.followed(lambda: self._masks.serve(change))
        if seen_kinds(self.document.run.session) != known:
            self._show_session()

    def _say_warnings(self, *more: str) -> None:
        for warning in filter(None, (*more, *self.document.run.session.warnings)):
            if warning not in self._told:
                self._told.add(warning)
                self._say("warning", "About this session", warning)

    def _see_arm(self) -> None:
        # never under a job: what it solves for would change
        arm = {} if self.jobs.busy else edits.seen_arm(self.document)
        if arm:
            self.store.do("Forearm in view", arm, kind=NOTE)
            self._show_session()
            self._show_all()

    # ---- edits

    def _edit(
        self,
        frame: int,
        values: edits.Values,
        words: str,
        tag: str = "",
        is_stroke: bool = False,
    ) -> None:
        """Change a pose, and show it. It is written when edits rest. words: what is done, for undo."""
        frame = self.document.clamped(frame)
        try:
            done = f"{words}, frame {frame}"
            self.store.do(done, values, tag, waits=True, is_stroke=is_stroke)
        finally:
            self.document.show(frame)
            self._show_pose()

    def write_what_rests(self) -> None:
        """Write edits once none came for a while; what fails is told, and tried again with the next."""
        try:
            if self.store.write_what_rests():
                self._announce(timeline_snapshot(self.document))
        finally:
            self._tell_work()

    def _tell_work(self) -> None:
        """Say what is on disk, where that changed."""
        if not self.store.has_edits_to_write:
            self._written = self._served
        now = work_snapshot(self.document, self.store.saved, self._written, self._served)
        if now != self._told_work:
            self._told_work = now
            self._publish(now)

    # ---- showing

    def _say(self, level: str, title: str, text: str) -> None:
        self._publish(Notice(level, title, text))

    def _announce(self, snapshot: Snapshot) -> None:
        """Publish; a pose shown makes the pictures stale."""
        self._publish(snapshot)
        self._review.seen(snapshot)
        if isinstance(snapshot, PoseSnapshot):
            whole = snapshot.beside is not None
            self.painter.is_stale, self.painter.hurried = not whole, self.jobs.busy
            self._score.shown()
            guesses = self.jobs.guesses.snapshot()
            if guesses is not None:
                self._publish(guesses)
            self._clouds.show(hurried=self.jobs.busy)
            if not whole:
                self._masks.show(hurried=self.jobs.busy)

    def _show_session(self) -> None:
        self._publish(session_snapshot(self.document))

    def _show_pose(self, is_played: bool = False) -> None:
        """Publish the pose; of a frame that is played, with its pictures."""
        pose = pose_snapshot(self.document)
        if is_played:
            made = self.painter.painted(), self._masks.picture()
            pose = replace(pose, beside=tuple(one for one in made if one is not None))
        self._announce(pose)

    def _show_all(self) -> None:
        self._show_pose()
        self._announce(timeline_snapshot(self.document))

    @property
    def rest_s(self) -> float:
        """How long the worker may wait for a command before there is something to do."""
        if self._live is not None and self._live.recording and not self.painter.is_stale:
            return 0.0
        return self.painter.rest_s

    def idle(self) -> None:
        """Do what waits while no command does."""
        if self._live is not None:
            self._watch_live(self._live)
        elif not self._counted and self.document.run.session.is_counted:
            self._take_count()
        if self.painter.is_stale:
            self.painter.paint()
        elif self._score.is_due and not self.jobs.busy:
            self._score.tell()
        elif not self.document.rows.is_whole:  # of a long track, while nobody waits
            if not read_more(self.document):
                self._announce(timeline_snapshot(self.document))
        else:
            self.jobs.tick()

    def close(self) -> list[str]:
        """Keep the last edits and end what runs; return what is to be said at the end."""
        self._tuning.close()
        said = [] if self._live is None else self._live.close()
        try:
            self.store.close()
        finally:
            self._tell_work()
        return said

    def _watch_live(self, live: LiveControl) -> None:
        """Show the newest images while nothing is tracked and nobody poses the hand in one of them."""
        if live.tell() and not self.jobs.busy:
            self._announce(timeline_snapshot(self.document))
        follow = self.jobs.follow
        if not self.jobs.busy and (follow or live.recording) and live.watch(follow) and follow:
            self._show_pose()

    def _take_count(self) -> None:
        """Go by the videos' true frames, now that they are counted, and say what is odd about them."""
        document, self._counted = self.document, True
        if document.see_frames():
            document.show(document.frame)
            self._show_session()
            self._show_all()
        self._say_warnings()
        if document.first_frame not in document.frames:
            raise HandtrackError(
                f"The first-frame pose is of frame {document.first_frame}, but the videos have the frames 0 to "
                f"{len(document.frames) - 1} only. Pose the {document.model.kind} in one of these, and save the first-frame pose anew."
            )
