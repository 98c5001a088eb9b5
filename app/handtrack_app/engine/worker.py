"""The worker: one thread that opens a session and serves the page's commands. It knows no viser."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack_app.engine import opening
from handtrack_app.engine.camera_pictures import Painter
from handtrack_app.engine.compile_watch import CompileWatch
from handtrack_app.engine.document import Document
from handtrack_app.engine.document_snapshots import (
    pose_snapshot,
    session_snapshot,
    timeline_snapshot,
)
from handtrack_app.engine.live_control import open_live_document
from handtrack_app.engine.open_session import OpenSession
from handtrack_app.engine.posing_service import pose
from handtrack_app.engine.service import RenderThread
from handtrack_app.process.child import EnginePlan
from handtrack_app.protocol import (
    Call,
    Command,
    Mailbox,
    Notice,
    Opened,
    ProgressSnapshot,
    Snapshot,
    commands_of,
)
from handtrack_app.rerun_recorder import LiveRecorder


class Preview(Painter):
    """Lives on the worker's thread. Calls besides these wait until the session is open."""

    def __init__(
        self, document: Document, publish: Callable[[Snapshot], None], thread: RenderThread
    ) -> None:
        super().__init__(document, publish, thread)
        publish(session_snapshot(document))
        publish(timeline_snapshot(document))

    @Command()
    def show_frame(self, frame: int, is_played: bool = False) -> None:
        """Show a frame."""
        self._document.show(frame)
        self._publish(pose_snapshot(self._document))
        self.show()

    @Command()
    def set_pose(self, frame: int, values: tuple[float, ...], version: int, **_: object) -> None:
        """Show a pose that is set by hand; the open session sets it."""
        self._document.apply(pose(self._document, frame, values))
        self._document.version = version
        self.show_frame(frame)


Opener = Callable[[Path], Document]
_PREPARING = "Preparing the first pose …"


class Worker:
    """Serves commands in the order they came; poses and frames before pictures; tracking runs beside it."""

    def __init__(self, plan: EnginePlan, publish: Callable[[Snapshot], None]) -> None:
        self._plan, self._publish = plan, publish
        self._recorder = LiveRecorder(publish, plan.rerun)
        self._mail: Mailbox[Call | Callable[[], None]] = Mailbox(
            lambda item: item.key if isinstance(item, Call) else None,
            lambda item: isinstance(item, Call) and item.is_step,
        )
        self._stopping, self._shown = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work, name="worker", daemon=True)
        self._render_thread = RenderThread(publish)
        self._failure: Exception | None = None
        self.last_words: list[str] = []
        """what is to be said once the worker has ended, in sentences"""
        self._preview: Preview | None = None
        self.session: OpenSession | None = None
        """that is open"""
        self._compiles = CompileWatch(self._compiling)
        self._later: list[Call] = []
        """calls that the open session is to serve, in their order"""

    # ---- from the page

    def start(self) -> None:
        self._thread.start()

    def send(self, call: Call) -> None:
        """Take a call; returns at once. Stopping and pausing act before the call's turn."""
        if self.session is not None and (act := call.command.at_once):
            getattr(self.session.jobs, act)(**call.arguments)
        self._mail.put(call)

    def stop(self, timeout: float = 5.0) -> None:
        """End the threads, then the recorder; the store already has what was saved."""
        self._stopping.set()
        if self.session is not None:
            self.session.jobs.stop(timeout)
        self._mail.close()
        self._thread.join(timeout)
        self._render_thread.stop()
        self._compiles.close()
        self._recorder.close()

    # ---- on the worker's thread

    def _work(self) -> None:
        self._publish(ProgressSnapshot("opening", f"Opening {self._plan.folder.name} …"))
        threading.Thread(target=self._open, name="opening", daemon=True).start()
        while not self._stopping.is_set():
            item = self._mail.take(0.1 if self.session is None else self.session.rest_s)
            if isinstance(item, Call):
                self._guarded(partial(self._serve, item))
            elif item is not None:
                self._guarded(item)
            elif self.session is not None:
                self._guarded(self.session.idle)
            if self.session is not None:
                self._guarded(self.session.write_what_rests)
        session = self.session
        if session is not None:
            self._guarded(lambda: self.last_words.extend(session.close()))

    def _open(self) -> None:
        """Open the session, on a thread of its own: what can be shown first, then what takes longer."""
        try:
            plan = self._plan
            if plan.opener is not None:
                document = plan.opener(plan.folder)
            elif plan.live is not None:
                document = open_live_document(plan.live, plan.folder)
            else:
                session = opening.opened(plan.folder)
                if plan.preview:
                    self._mail.put(partial(self._look_at, opening.preview(session)))
                    while not self._shown.wait(0.1):  # nothing is fitted before the first picture
                        if self._stopping.is_set():
                            return
                document = opening.document(session)
            self._mail.put(partial(self._begin, document))
        except Exception as error:
            self._mail.put(partial(self._begin, error))

    def _guarded(self, action: Callable[[], None]) -> None:
        try:
            action()
        except Exception as error:
            self._publish(Notice.of_error(error, "That did not work"))

    def _compiling(self, words: str) -> None:
        if self.session is None:  # later on, it is told with the jobs' progress
            self._publish(ProgressSnapshot("opening", words))

    def _serve(self, call: Call) -> None:
        if self.session is not None:
            self.session.serve(call)
        elif self._preview is None and call.is_kept and call.name != "show_frame":
            raise HandtrackError("No session is open yet.")
        elif call.name != "cancel":
            if self._preview is not None and call.name in commands_of(Preview):
                getattr(self._preview, call.name)(**call.arguments)
            self._later.append(call)

    def _look_at(self, document: Document) -> None:
        self._preview = Preview(document, self._publish, self._render_thread)
        self._preview.show_frame(document.first_frame)
        self._publish(ProgressSnapshot("opening", _PREPARING))
        self._render_thread.wait_for(lambda: None)  # which are made before
        self._set_shown()

    def _set_shown(self) -> None:
        if not self._shown.is_set():
            self._shown.set()
            self._publish(Opened(self._failure, is_whole=False))

    def _begin(self, document: Document | Exception) -> None:
        """Show the session and serve what was asked for meanwhile."""
        try:
            if isinstance(document, Exception):
                raise document
            document.version = self._plan.version
            session = OpenSession(
                document, self._publish, self._mail.put, self._render_thread, self._recorder, self._compiles, self._plan
            )  # fmt: skip
        except Exception as error:
            self._failure = error
            self._publish(ProgressSnapshot("failed", "The session could not be opened."))
            raise
        else:
            self.session = session
            session.show_first()
        finally:
            self._set_shown()
            self._publish(Opened(self._failure, is_whole=True))
        for call in self._later:
            self._guarded(partial(session.serve, call))
        self._later, self._preview = [], None
