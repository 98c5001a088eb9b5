"""The worker: one thread that owns what is open; commands in, snapshots out. It knows no viser."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack_app.engine.compile_watch import CompileWatch
from handtrack_app.engine.document import Document, params_of
from handtrack_app.engine.document_snapshots import pose_snapshot, session_snapshot, strip_snapshot
from handtrack_app.engine.job_control import Conductor
from handtrack_app.engine.jobs import Ended, Found, Report, Sized, Tracked, Watch
from handtrack_app.engine.opening import nothing_seen, open_document
from handtrack_app.engine.pictures.camera_pictures import PictureMaker, contact_sheet
from handtrack_app.engine.pictures.cloud_service import CloudDesk
from handtrack_app.engine.pictures.render_thread import Aside
from handtrack_app.engine.store.persistence import Keeper
from handtrack_app.engine.store.tracks import export
from handtrack_app.protocol import commands, snapshots
from handtrack_app.protocol.mailbox import Mailbox

log = logging.getLogger(__name__)
_PAINT_EVERY_S = 0.08  # pictures are painted at most this often: the hand itself comes first
_QUIET_S = 0.4  # an edit counts as accepted, and goes to the journal, after this long

_BY_HAND = (
    "Go to a frame where the {kind} is well seen, look through a camera, and pose it over the image: '{pose} as', "
    "'Nudge', then 'Fit to the images' and 'Save as first-frame pose'."
)
_NO_POSE = {
    "hand": "Press 'Find the hand', if it is open in some frame. Or pose it: "
    + _BY_HAND.format(kind="hand", pose="Fingers"),
    "body": _BY_HAND.format(kind="body", pose="Pose"),
}

_FIXED = "Settings stay fixed while tracking runs, so that a result has one. Cancel it first."

Request = commands.Command | Report
Publish = Callable[[snapshots.Snapshot], None]
Opener = Callable[[Path, Mapping[str, object]], Document]


def _kind(request: Request) -> Hashable | None:
    latest_wins = (
        commands.SetPose, commands.PullTip, commands.ShowFrame, commands.WantPictures, commands.WantCloud, commands.WantSurface, commands.SampleSkin,
    )  # fmt: skip
    if isinstance(request, commands.SetClouds):
        return ("clouds", *(name for name, _ in request.values))
    if isinstance(request, commands.SetSetting):
        return ("setting", request.name)
    if isinstance(request, commands.SetLimits):
        return ("limits", request.name)
    return type(request) if isinstance(request, latest_wins) else None


class Worker:
    """Serves commands in the order they came; poses and frames before pictures; tracking runs beside it."""

    def __init__(
        self,
        folder: Path,
        publish: Publish,
        opener: Opener = open_document,
        watch: Watch | None = None,
    ) -> None:
        self.folder = folder
        self._watch = watch
        self._publish, self._opener = publish, opener
        self._mail: Mailbox[Request] = Mailbox(_kind)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._work, name="worker", daemon=True)
        self._opened = threading.Event()
        self._failure: Exception | None = None
        self._document: Document | None = None
        self._keeper: Keeper | None = None
        self._pictures: PictureMaker | None = None
        self._wanted = commands.WantPictures(True, None, "plain")
        self._conductor: Conductor | None = None
        self._aside = Aside(publish)
        self._desk: CloudDesk | None = None
        self._wishes: dict[type, commands.WantCloud | commands.WantSurface] = {}
        self._compiles = CompileWatch(self._compiling)
        self._stale_pictures, self._painted = False, 0.0
        self._unsaved: int | None = None
        self._edited = 0.0

    # ---- from the page

    def start(self) -> None:
        self._thread.start()
        self._aside.start()

    def wait_opened(self, timeout: float) -> Exception | None:
        """Wait for the session to open, a while at most; return why it could not."""
        self._opened.wait(timeout)
        return self._failure

    def send(self, command: commands.Command) -> None:
        """Hand over a command; returns at once. Stopping and holding act before the queue's turn."""
        conductor = self._conductor
        if conductor is not None:
            match command:
                case commands.Cancel():
                    conductor.cancel()
                case commands.Pause():
                    conductor.pause(command.on)
                case commands.Follow():
                    conductor.follow = command.on
                case (
                    commands.SetPose()
                    | commands.TakePose()
                    | commands.PullTip()
                    | commands.ShowFrame()
                    | commands.TakeGuess()
                ):
                    conductor.follow = False  # the user looks elsewhere: tracking goes on behind
        self._mail.put(command)

    def stop(self, timeout: float = 5.0) -> None:
        """End the thread; the journal already holds what was accepted."""
        self._stopping.set()
        if self._conductor is not None:
            self._conductor.stop(timeout)
        self._thread.join(timeout)
        self._aside.stop(timeout)

    # ---- on the worker's thread

    def _work(self) -> None:
        self._guarded(self._open)
        while not self._stopping.is_set():
            rest = self._painted + _PAINT_EVERY_S - time.monotonic()
            request = self._mail.take(max(rest, 0.0) if self._stale_pictures else 0.1)
            if request is not None:
                self._guarded(lambda request=request: self._serve(request))
            elif self._stale_pictures:
                self._guarded(self._show_pictures)
            elif self._conductor is not None:
                self._conductor.tick()
            if self._unsaved is not None and time.monotonic() - self._edited > _QUIET_S:
                self._guarded(self._accept_edit)
        self._guarded(self._accept_edit)
        if self._keeper is not None:
            self._guarded(self._keeper.close)

    def _kept(self) -> Keeper:
        assert self._keeper is not None, "no session is open"
        return self._keeper

    def _note(self, kind: str, data: dict[str, object]) -> None:
        self._kept().note(kind, data)

    def _guarded(self, action: Callable[[], None]) -> None:
        try:
            action()
        except HandtrackError as error:
            self._publish(snapshots.Notice("error", "That did not work", str(error)))
        except Exception as error:  # the page must go on, and the user must know
            log.exception("internal error")
            self._publish(snapshots.Notice.of_mistake(error))

    def _compiling(self, words: str) -> None:
        if self._conductor is None:  # later on, the conductor tells it with its progress
            self._publish(snapshots.ProgressSnapshot("opening", words))

    def _open(self) -> None:
        self._publish(snapshots.ProgressSnapshot("opening", f"Opening {self.folder.name} …"))
        try:
            self._document = self._opener(self.folder, {})
        except Exception as error:
            self._failure = error
            self._opened.set()
            self._publish(snapshots.ProgressSnapshot("failed", "The session could not be opened."))
            raise
        document = self._document
        self._keeper = Keeper.open(document)
        restored = self._keeper.restore()
        self._pictures = PictureMaker(document.run.session)
        self._conductor = Conductor(
            document, self._keeper, self._announce, self._mail.put, self._watch, self._compiles
        )
        self._desk = CloudDesk(document, self._aside)
        self._publish(session_snapshot(document))
        self._publish(self._desk.card())
        document.show(document.first_frame)
        for wish in self._wishes.values():
            self._desk.want(wish)
        self._show_all()
        if restored:
            self._publish(snapshots.Notice("info", "Welcome back", restored))
        blind = nothing_seen(document.run)
        if blind:
            self._publish(snapshots.Notice("warning", "Nothing to track by yet", blind))
        elif document.run.first is None:
            self._publish(
                snapshots.Notice("info", "No first pose yet", _NO_POSE[document.model.kind])
            )
        for warning in filter(None, (self._keeper.warning, *document.run.session.warnings)):
            self._publish(snapshots.Notice("warning", "About this session", str(warning)))
        self._conductor.show_progress()
        self._opened.set()

    def _serve(self, request: Request) -> None:
        document, conductor, desk = self._document, self._conductor, self._desk
        if isinstance(request, commands.WantCloud | commands.WantSurface):
            self._wishes[type(request)] = request
        if document is None or conductor is None or desk is None:
            if not isinstance(
                request, (commands.WantPictures, commands.WantCloud, commands.WantSurface, commands.ShowFrame, commands.Cancel)
            ):  # fmt: skip
                raise HandtrackError("No session is open yet.")
            return
        match request:
            case commands.SetPose():
                if request.version >= document.version:
                    document.version = request.version
                    document.set_pose(request.frame, request.values)
                    self._edit(document)
            case commands.ShowFrame():
                self._accept_edit()
                document.show(request.frame)
                self._show_pose()
            case commands.TakePose():
                document.version = max(document.version, request.version)
                document.take_pose(request.frame, request.source)
                self._edit(document)
            case commands.PullTip():
                document.version = max(document.version, request.version)
                document.pull_tip(request.frame, request.tip, request.target)
                self._edit(document)
            case commands.ForgetPose():
                document.version = max(document.version, request.version)
                document.forget_pose(request.frame)
                self._note("forget", {"frame": request.frame})
                self._show_all()
            case commands.WantPictures():
                self._wanted, self._stale_pictures = request, True
            case commands.Track():
                self._accept_edit()
                document.version = max(document.version, request.version)
                if request.stop - request.start == 1 and document.frame == request.first:
                    self._see_arm(document)
                conductor.track(request)
            case commands.FitSize():
                conductor.fit_size()
            case commands.Pause():
                conductor.show_progress()
            case commands.Cancel():
                conductor.leave()  # acted on in `send` already; most jobs report their end themselves
            case commands.Follow():
                pass  # acted on in `send`
            case commands.SetSetting() | commands.SetLimits():
                self._change(document, request)
            case commands.SaveSettings():
                self._save_settings(document)
            case commands.WantCloud() | commands.WantSurface():
                desk.want(request)
            case (
                commands.SetClouds()
                | commands.UseClouds()
                | commands.SampleSkin()
                | commands.RestoreClouds()
                | commands.SaveClouds()
            ):
                self._change_clouds(desk, request)
            case commands.SavePose():
                self._see_arm(document)
                text = self._kept().save_first_pose()
                self._publish(snapshots.Notice("done", "First-frame pose saved", text))
            case commands.SaveTrack():
                self._publish(snapshots.Notice("done", "Track saved", self._kept().save_track()))
            case commands.Export():
                name, data = export(document, request.kind)
                self._publish(snapshots.Download(name, data, request.client_id))
            case commands.FindHand():
                self._accept_edit()
                conductor.find(request.frame)
            case commands.TakeGuess():
                document.version = max(document.version, request.version)
                if conductor.guesses.take(request.frame, request.index):
                    self._kept().note_scale()
                    self._publish(session_snapshot(document))
                self._edit(document)
            case Tracked() | Sized() | Found() | Ended():
                conductor.take(request)

    # ---- posing and showing

    def _edit(self, document: Document) -> None:
        self._unsaved, self._edited = document.frame, time.monotonic()
        self._show_pose()

    def _accept_edit(self) -> None:
        if self._unsaved is None or self._document is None:
            return
        frame, self._unsaved = self._unsaved, None
        if frame in self._document.by_hand:
            self._kept().note_pose(frame)
        self._show_strip()

    def _see_arm(self, document: Document) -> None:
        if document.see_arm():
            self._publish(session_snapshot(document))
            self._show_all()

    def _announce(self, snapshot: snapshots.Snapshot) -> None:
        """Publish; a pose shown makes the pictures stale."""
        self._publish(snapshot)
        if isinstance(snapshot, snapshots.PoseSnapshot):
            self._stale_pictures = True
            guesses = None if self._conductor is None else self._conductor.guesses.snapshot()
            if guesses is not None:
                self._publish(guesses)
            if self._desk is not None:
                busy = self._conductor is not None and self._conductor.busy
                self._desk.show(hurried=busy)

    def _show_pose(self) -> None:
        if self._document is not None:
            self._announce(pose_snapshot(self._document))

    def _show_strip(self) -> None:
        if self._document is not None:
            self._publish(strip_snapshot(self._document))

    def _show_all(self) -> None:
        self._show_pose()
        self._show_strip()

    def _show_pictures(self) -> None:
        """Paint what the page wants; a command that comes meanwhile goes first, and painting begins anew."""
        self._stale_pictures, self._painted = False, time.monotonic()
        document, maker, wanted = self._document, self._pictures, self._wanted
        if document is None or maker is None:
            return
        frame, names = document.frame, document.run.session.rig.names
        bones = document.model.bones(params_of(document.model, document.shown))
        flesh = document.model.flesh["fine"].posed(bones)
        large, screen = None, wanted.screen if wanted.screen in names else None
        if screen is not None:
            residual = wanted.paint == "residual"
            session = document.run.session
            seen = session.observation(frame, cloud=False).silhouettes if residual else ()
            mask = next((s.mask for s in seen if s.camera.name == screen), None)
            large = maker.screen(screen, frame, wanted.paint, flesh, mask)
            self._publish(snapshots.PictureSnapshot(frame, screen=screen, screen_image=large))
        small = {}
        for name in names if wanted.thumbnails else ():
            if len(self._mail):
                self._stale_pictures = True
                return
            small[name] = maker.thumbnail(name, frame, wanted.paint, flesh)
        if small:
            self._publish(
                snapshots.PictureSnapshot(frame, small, contact_sheet(small), screen, large)
            )

    def _change_clouds(
        self,
        desk: CloudDesk,
        change: commands.SetClouds
        | commands.UseClouds
        | commands.SampleSkin
        | commands.RestoreClouds
        | commands.SaveClouds,
    ) -> None:
        keeper = self._kept()
        try:
            if self._conductor is not None and self._conductor.busy:
                raise HandtrackError(_FIXED)
            match change:
                case commands.SetClouds():
                    desk.change(dict(change.values))
                case commands.UseClouds():
                    desk.use(change.settings)
                case commands.SampleSkin():
                    text = desk.sample_skin(change)
                    self._publish(snapshots.Notice("done", "The skin's colour is taken", text))
                case commands.RestoreClouds():
                    desk.restore()
                case commands.SaveClouds():
                    self._publish(
                        snapshots.Notice("done", "Clouds' settings saved", keeper.save_clouds())
                    )
        finally:
            self._publish(desk.card())  # the page shows what holds
        if not isinstance(change, commands.SaveClouds):
            keeper.note_clouds()

    def _save_settings(self, document: Document) -> None:
        if self._conductor is not None and self._conductor.busy:
            raise HandtrackError(_FIXED)
        self._publish(snapshots.Notice("done", "Settings saved", self._kept().save_settings()))
        self._publish(session_snapshot(document))

    def _change(self, document: Document, change: commands.SetSetting | commands.SetLimits) -> None:
        if self._conductor is not None and self._conductor.busy:
            self._publish(session_snapshot(document))  # the page goes back to what holds
            raise HandtrackError(_FIXED)
        try:
            if isinstance(change, commands.SetLimits):
                document.set_limits(change.name, change.interval)
            else:
                document.replace_run(document.run.with_values({change.name: change.value}))
                self._kept().note_setting(change.name, change.value)
        finally:
            self._publish(session_snapshot(document))
        if isinstance(change, commands.SetLimits):
            self._note("limits", {"name": change.name, "interval": change.interval})
        self._show_all()
