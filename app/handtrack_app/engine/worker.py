"""The worker: one thread that opens a session and serves the page's commands. It knows no viser."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack_app.engine.compile_watch import CompileWatch
from handtrack_app.engine.document import Document
from handtrack_app.engine.jobs import Watch
from handtrack_app.engine.open_session import OpenSession, Request
from handtrack_app.engine.opening import open_document
from handtrack_app.engine.pictures.render_thread import RenderThread
from handtrack_app.protocol import commands
from handtrack_app.protocol.mailbox import Mailbox
from handtrack_app.protocol.snapshots import Notice, ProgressSnapshot, Snapshot

log = logging.getLogger(__name__)
Opener = Callable[[Path, Mapping[str, object]], Document]

_LATEST_WINS = (
    commands.SetPose, commands.PullTip, commands.ShowFrame, commands.WantPictures, commands.WantCloud,
    commands.WantSurface, commands.SampleSkin,
)  # fmt: skip
_LOOKS_ELSEWHERE = (
    commands.SetPose, commands.TakePose, commands.PullTip, commands.ShowFrame, commands.TakeGuess,
)  # fmt: skip
_BEFORE_OPENING = (
    commands.WantPictures, commands.WantCloud, commands.WantSurface, commands.ShowFrame, commands.Cancel,
)  # fmt: skip


def _kind(request: Request) -> Hashable | None:
    if isinstance(request, commands.SetClouds):
        return ("clouds", *(name for name, _ in request.values))
    if isinstance(request, commands.SetSetting):
        return ("setting", request.name)
    if isinstance(request, commands.SetLimits):
        return ("limits", request.name)
    return type(request) if isinstance(request, _LATEST_WINS) else None


class Worker:
    """Serves commands in the order they came; poses and frames before pictures; tracking runs beside it."""

    def __init__(
        self,
        folder: Path,
        publish: Callable[[Snapshot], None],
        opener: Opener = open_document,
        watch: Watch | None = None,
    ) -> None:
        self.folder = folder
        self._publish, self._opener, self._watch = publish, opener, watch
        self._mail: Mailbox[Request] = Mailbox(_kind)
        self._stopping, self._opened = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work, name="worker", daemon=True)
        self._render_thread = RenderThread(publish)
        self._failure: Exception | None = None
        self.last_words: list[str] = []
        """what is to be said once the worker has ended, in sentences"""
        self._session: OpenSession | None = None
        self._compiles = CompileWatch(self._compiling)
        self._wishes: dict[type, commands.WantCloud | commands.WantSurface] = {}

    # ---- from the page

    def start(self) -> None:
        self._thread.start()
        self._render_thread.start()

    def wait_opened(self, timeout: float) -> Exception | None:
        """Wait for the session to open, a while at most; return why it could not."""
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

    def send(self, command: commands.Command) -> None:
        """Hand over a command; returns at once. Stopping and holding act before the queue's turn."""
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
        self._mail.put(command)

    def stop(self, timeout: float = 5.0) -> None:
        """End the thread; the journal already holds what was accepted."""
        self._stopping.set()
        if self._session is not None:
            self._session.jobs.stop(timeout)
        self._thread.join(timeout)
        self._render_thread.stop(timeout)
        self._compiles.close()

    # ---- on the worker's thread

    def _work(self) -> None:
        self._guarded(self._open)
        session = self._session
        while not self._stopping.is_set():
            request = self._mail.take(0.1 if session is None else session.rest_s)
            if request is not None:
                self._guarded(lambda request=request: self._serve(request))
            elif session is not None:
                self._guarded(session.idle)
            if session is not None:
                self._guarded(session.accept_settled_edit)
        if session is not None:
            self._guarded(lambda: self.last_words.extend(session.close()))

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

    def _open(self) -> None:
        self._publish(ProgressSnapshot("opening", f"Opening {self.folder.name} …"))
        try:
            session = OpenSession(
                self._opener(self.folder, {}), self._publish, self._mail, self._render_thread,
                self._watch, self._compiles,
            )  # fmt: skip
        except Exception as error:
            self._failure = error
            self._opened.set()
            self._publish(ProgressSnapshot("failed", "The session could not be opened."))
            raise
        self._session = session
        session.show_first(list(self._wishes.values()))
        self._opened.set()

    def _serve(self, request: Request) -> None:
        if self._session is not None:
            self._session.serve(request)
        elif isinstance(request, commands.WantCloud | commands.WantSurface):
            self._wishes[type(request)] = request
        elif not isinstance(request, _BEFORE_OPENING):
            raise HandtrackError("No session is open yet.")
