"""The worker: one thread that opens a session and serves the page's commands. It knows no viser."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack_app.engine.compile_watch import CompileWatch
from handtrack_app.engine.document import Document
from handtrack_app.engine.jobs import Watch
from handtrack_app.engine.open_session import OpenSession
from handtrack_app.engine.open_session import Request as SessionRequest
from handtrack_app.engine.opening import open_document
from handtrack_app.engine.pictures.render_thread import RenderThread
from handtrack_app.engine.preview import Preview
from handtrack_app.protocol import commands
from handtrack_app.protocol.commands import Numbered, is_step
from handtrack_app.protocol.commands import kind_of as _kind
from handtrack_app.protocol.mailbox import Mailbox
from handtrack_app.protocol.snapshots import Notice, ProgressSnapshot, Snapshot

log = logging.getLogger(__name__)
Opener = Callable[[Path, Mapping[str, object]], Document]


@dataclass(frozen=True, eq=False)
class _Previewed:
    """There is something to be looked at."""

    document: Document


@dataclass(frozen=True, eq=False)
class _Opened:
    """The session can be worked in, or why it cannot."""

    document: Document | Exception


Request = SessionRequest | Numbered | _Previewed | _Opened

_LOOKS_ELSEWHERE = (
    commands.SetPose, commands.TakePose, commands.PullPlace, commands.LookBefore, commands.ShowFrame, commands.TakeGuess,
    commands.Undo, commands.Redo, commands.SetPin, commands.DropPins, commands.ForgetPose,
)  # fmt: skip
_MOVES = commands.SetPose, commands.PullPlace, commands.SetPin
"""what comes twenty times a second while somebody drags"""
_PREPARING = "Preparing the first pose …"


class Worker:
    """Serves commands in the order they came; poses and frames before pictures; tracking runs beside it."""

    def __init__(
        self,
        folder: Path,
        publish: Callable[[Snapshot], None],
        opener: Opener = open_document,
        watch: Watch | None = None,
        previewer: Opener | None = None,
        take_over: bool = False,
        page: str = "",
    ) -> None:
        """previewer: makes quickly what is shown while `opener` is at work. take_over: write, even if another program does. page:
        whose numbers its commands have.
        """
        self.folder = folder
        self._publish, self._opener, self._watch = publish, opener, watch
        self._previewer, self._take_over, self._page = previewer, take_over, page
        self._mail: Mailbox[Request] = Mailbox(_kind, is_step)
        self._stopping, self._opened = threading.Event(), threading.Event()
        self._shown = threading.Event()
        self._thread = threading.Thread(target=self._work, name="worker", daemon=True)
        self._render_thread = RenderThread(publish)
        self._failure: Exception | None = None
        self.last_words: list[str] = []
        """what is to be said once the worker has ended, in sentences"""
        self._preview: Preview | None = None
        self._session: OpenSession | None = None
        self._compiles = CompileWatch(self._compiling)
        self._wishes: dict[type, commands.Command] = {}

    # ---- from the page

    def start(self) -> None:
        self._thread.start()
        self._render_thread.start()

    def wait_shown(self, timeout: float) -> Exception | None:
        """Wait for the first picture, a while at most; return why the session could not be opened."""
        self._shown.wait(timeout)
        return self._failure

    def wait_opened(self, timeout: float | None) -> Exception | None:
        """Wait until the session can be worked in, a while at most; return why it could not be opened."""
        self._opened.wait(timeout)
        return self._failure

    @property
    def document(self) -> Document:
        """What is open; not to be asked before."""
        assert self._session is not None, "no session is open"
        return self._session.document

    @property
    def busy(self) -> bool:
        """Whether a job runs."""
        return self._session is not None and self._session.jobs.busy

    def send(self, request: commands.Command | Numbered) -> None:
        """Hand over a command; returns at once. Stopping and holding act before the queue's turn."""
        command = request.command if isinstance(request, Numbered) else request
        if self._session is not None:
            jobs = self._session.jobs
            if isinstance(command, commands.Cancel):
                jobs.cancel()
            elif isinstance(command, commands.Pause):
                jobs.pause(command.on)
            elif isinstance(command, commands.Follow):
                jobs.follow = command.on
            elif isinstance(command, _LOOKS_ELSEWHERE):
                jobs.follow = False  # tracking goes on behind
                if isinstance(command, _MOVES):
                    jobs.give_way()
        self._mail.put(request)

    def stop(self, timeout: float = 5.0) -> None:
        """End the thread; the store already has what was saved."""
        self._stopping.set()
        if self._session is not None:
            self._session.jobs.stop(timeout)
        self._thread.join(timeout)
        self._render_thread.stop(timeout)
        self._compiles.close()

    # ---- on the worker's thread

    def _work(self) -> None:
        self._publish(ProgressSnapshot("opening", f"Opening {self.folder.name} …"))
        threading.Thread(target=self._open, name="opening", daemon=True).start()
        while not self._stopping.is_set():
            desk = self._session or self._preview
            request = self._mail.take(0.1 if desk is None else desk.rest_s)
            if request is not None:
                self._guarded(lambda request=request: self._serve(request))
            elif desk is not None:
                self._guarded(desk.idle)
            if self._session is not None:
                self._guarded(self._session.write_what_rests)
            elif self._preview is not None and not self._preview.painter.is_stale:
                self._shown.set()
        session = self._session
        if session is not None:
            self._guarded(lambda: self.last_words.extend(session.close()))

    def _open(self) -> None:
        """Open the session, on a thread of its own: what can be shown first, then what takes longer."""
        try:
            if self._previewer is not None:
                self._mail.put(_Previewed(self._previewer(self.folder, {})))
                while not self._shown.wait(0.1):  # nothing is fitted before the first picture
                    if self._stopping.is_set():
                        return
            self._mail.put(_Opened(self._opener(self.folder, {})))
        except Exception as error:
            self._mail.put(_Opened(error))

    def _guarded(self, action: Callable[[], None]) -> None:
        try:
            action()
        except HandtrackError as error:
            self._publish(Notice("error", "That did not work", str(error)))
        except Exception as error:  # the page must go on, and the user must know
            log.exception("internal error")
            self._publish(Notice.of_mistake(error))

    def _compiling(self, words: str) -> None:
        if self._session is None:  # later on, it is told with the jobs' progress
            self._publish(ProgressSnapshot("opening", words))

    def _serve(self, request: Request) -> None:
        session, preview = self._session, self._preview
        match request:
            case _Previewed():
                self._preview = Preview(request.document, self._publish, self._mail)
                self._preview.show_first()
                self._publish(ProgressSnapshot("opening", _PREPARING))
            case _Opened():
                self._begin(request.document)
            case _ if session is not None:
                session.serve(request)
            case commands.WantCloud() | commands.WantSurface() | commands.WantMasks():
                self._wishes[type(request)] = request
            case commands.Cancel():
                pass
            case _ if preview is not None:
                preview.serve(request)
            case commands.WantPictures() | commands.ShowFrame():
                pass
            case _:
                raise HandtrackError("No session is open yet.")

    def _begin(self, document: Document | Exception) -> None:
        """Show the session and serve what was asked for meanwhile."""
        try:
            if isinstance(document, Exception):
                raise document
            session = OpenSession(
                document, self._publish, self._mail.put, self._mail, self._render_thread, self._watch,
                self._compiles, self._take_over, self._page,
            )  # fmt: skip
        except Exception as error:
            self._failure = error
            self._publish(ProgressSnapshot("failed", "The session could not be opened."))
            raise
        else:
            self._session = session
            session.show_first(list(self._wishes.values()))
        finally:
            self._shown.set()
            self._opened.set()
        for command in () if self._preview is None else self._preview.later:
            self._guarded(lambda command=command: session.serve(command))
        self._preview = None
