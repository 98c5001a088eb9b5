"""The engine in a process of its own: when it dies, the page lives on, says so, and goes on with a new one."""

from __future__ import annotations

import logging
import re
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast
from uuid import uuid4

from handtrack.errors import HandtrackError
from handtrack_app.log import ENGINE_LOG
from handtrack_app.process.child import GB, Commands, Ended, EngineChild, EnginePlan, Stop
from handtrack_app.process.outbox import Outbox, named
from handtrack_app.protocol.calls import Call, Caller, Engine
from handtrack_app.protocol.snapshots import Notice, Opened, ProgressSnapshot, Snapshot

_TAIL = 20_000  # bytes of the log in which the last words of a crash stand, with the stacks of all threads
_MEMORY = re.compile(
    rb"out of memory|bad_alloc|MemoryError|cannot allocate|insufficient memory", re.I
)
_CRASHES = {"SIGSEGV", "SIGBUS", "SIGILL", "SIGFPE", "SIGABRT", "SIGSYS", "SIGTRAP"}


def ending_words(code: int, memory: int | None, log: Path, since: int) -> str:
    """Return how the engine's process ended, in a sentence.

    code: its exit code, or the number of a signal below 0. memory: what it was allowed [bytes]. since: where in the log its
    words begin [bytes]; what ended one before it does not count.
    """
    limit = "" if memory is None else f" It may use {memory / GB:.1f} GB (--memory)."
    name = _signal_name(-code) if code < 0 else ""
    if name == "SIGKILL":
        return f"The engine was ended from outside (SIGKILL), as the system does when memory runs out.{limit}"
    if name in _CRASHES or code > 0:
        how = f"crashed ({name})" if name else f"ended with exit code {code}"
        if _MEMORY.search(_tail(log, since)):
            return f"The engine {how}, for want of memory.{limit}"
        return f"The engine {how}, a mistake in handtrack or in a library."
    if code == 0:
        return "The engine was asked to end (SIGTERM), by a person or by a guard of the memory."
    return f"The engine was ended from outside ({name})."


def again_notice(
    how: str,
    stopped_at: int | None,
    job: str,
    recording: str,
    edits: str,
    given_up: str,
    log: Path,
) -> Notice:
    """Return what the user is told when the engine begins again.

    stopped_at: the frame tracked last, if it tracked; job: what it was at; recording: the folder that running cameras were recorded
    to; edits: what is not on disk yet, and made again; given_up: what is not.
    """
    text = f"{how} It begins again from the disk."
    text += f" Not on disk yet, and done again now: {edits}." if edits else ""
    text += f" Given up: {given_up}." if given_up else ""
    if stopped_at is not None:
        text += f" Tracking stopped at frame {stopped_at}; there, 'From here' (tab Track) goes on."
    elif job and job != "tracking":
        text += f" What ran was cut off ({job}); begin it again."
    if recording:
        text += f" The recording in {recording} was cut off: its videos are there, its session.toml is not."
    return Notice("error", "The engine was ended", f"{text} Details: {log}")


def down_notice(how: str, times: int, edits: str, given_up: str, log: Path) -> Notice:
    """Return what the user is told when the engine stays ended. edits: what is not on disk; given_up: what is not done again."""
    often = f" That was {times} times within a minute." if times > 1 else ""
    waits = f" Not on disk yet: {edits}; done again then." if edits else ""
    lost = f" Given up: {given_up}." if given_up else ""
    return Notice(
        "error",
        "The engine stays ended",
        f"{how}{often} It does not begin again by itself: 'Start again' (at the top) opens what is on disk.{waits}{lost} Details: {log}",
    )


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _tail(log: Path, since: int) -> bytes:
    try:
        with log.open("rb") as file:
            file.seek(max(since, log.stat().st_size - _TAIL))
            return file.read()
    except OSError:
        return b""


log = logging.getLogger(__name__)
_MOST_AGAIN = 3  # within so many seconds; after that it would only end once more
_WITHIN_S = 60.0
_AGAIN = "Opening the session again …"


class EngineProcess:
    """Has the face of a Worker. Calls wait until the session is shown."""

    def __init__(
        self,
        plan: EnginePlan,
        publish: Callable[[Snapshot], None],
        child: EngineChild | None = None,
    ) -> None:
        """child: a process started already, for the first life."""
        self.folder = plan.folder
        self.last_words: list[str] = []
        self._plan = replace(plan, page=plan.page or uuid4().hex)
        self._publish, self._child = publish, child
        self._outbox = Outbox(self._hand_over)
        self.engine = cast("Engine", Caller(self.call))
        """what the page calls; each call returns at once"""
        self._shown, self._opened = threading.Event(), threading.Event()
        self._stopping, self._again = threading.Event(), threading.Event()
        self._failure: Exception | None = None
        self._ends: deque[float] = deque(maxlen=_MOST_AGAIN + 1)
        self._life: EngineChild | None = None
        self._log_from = 0
        self._is_down = False
        self._thread = threading.Thread(target=self._live, name="engine", daemon=True)

    # ---- from the page

    @property
    def pid(self) -> int | None:
        """The number of the engine's process; None while there is none."""
        return None if self._life is None else self._life.pid

    def start(self) -> None:
        self._thread.start()

    def wait_shown(self, timeout: float) -> Exception | None:
        """Wait for the first picture, a while at most; return why the session could not be opened."""
        self._shown.wait(timeout)
        return self._failure

    def wait_opened(self, timeout: float | None) -> Exception | None:
        """Wait until the session can be worked in, a while at most; return why it could not be opened."""
        self._opened.wait(timeout)
        return self._failure

    def call(self, name: str, given: tuple[Any, ...], named_: Mapping[str, Any]) -> None:
        """Call a method of the engine; returns at once."""
        lost = self._outbox.put(name, given, named_)
        if lost is None:
            self._tell_work()
        else:
            text = f"The engine does not serve it now: {named([lost])}."
            self._publish(Notice("error", "Not done", text))

    def start_again(self) -> None:
        """Start the engine that ended too often."""
        self._again.set()

    def _hand_over(self, call: Call) -> None:
        if (life := self._life) is not None:
            life.send((call.name, call.arguments, call.number))

    def stop(self, timeout: float = 5.0) -> None:
        """End the engine in order, once what it was asked for is on disk; at once where it does not answer."""
        if not self._is_down and self._failure is None and self._thread.is_alive():
            self._outbox.wait_done(timeout)
        self._stopping.set()
        self._again.set()
        life = self._life
        if life is not None:  # its pipe may be full, with nobody at the other end
            threading.Thread(target=life.send, args=(Stop(timeout),), daemon=True).start()
        self._thread.join(2 * timeout)
        if life is not None and self._thread.is_alive():
            life.kill()
            self._thread.join(timeout)
        if lost := self._outbox.edits:
            self.last_words.append(f"Not saved, since the engine did not answer: {named(lost)}.")

    # ---- on the engine's thread

    def _live(self) -> None:
        plan = self._plan
        while not self._stopping.is_set():
            try:
                code = self._one_life(plan)
            except OSError:  # the system starts no more processes
                log.exception("no engine could be started")
                code = 1
            if not self._stopping.is_set() and not self._tell_end(code):
                self._again.wait()  # perhaps it was asked for before the process had ended
                self._again.clear()
                self._failure, self._is_down = None, False
                self._tell_work(is_down=False)
                self._ends.clear()
            plan = replace(plan, preview=False, take_over=False, version=self._outbox.version)

    def _one_life(self, plan: EnginePlan) -> int:
        """Let a process be the engine; return how it ended."""
        child, self._child = self._child or EngineChild(ENGINE_LOG), None
        self._life, self._log_from = child, child.log_from
        if self._stopping.is_set():  # which saw no life yet
            child.kill()
        child.send(plan)
        code = child.listen(lambda message: self._take(child, message, plan is not self._plan))
        self._life = None
        return code

    def _take(self, child: EngineChild, message: object, is_anew: bool) -> None:
        if isinstance(message, Commands):
            self._outbox.know(message.rules)
        elif isinstance(message, Opened) and not message.is_whole:
            self._failure = message.failure
            self._outbox.listen(is_anew)
            self._shown.set()
        elif isinstance(message, Opened):
            self._failure = message.failure
            self._opened.set()
            if message.failure is not None:
                child.send(Stop(1.0))
        elif isinstance(message, Ended):
            self.last_words = list(message.last_words)
        elif (told := self._outbox.see(cast("Snapshot", message))) is not None:
            self._publish(told)

    def _tell_work(self, is_down: bool | None = None) -> None:
        """Say where what is saved is not as it was said last."""
        work = self._outbox.work(is_down)
        if work is not None:
            self._publish(work)

    def _tell_end(self, code: int) -> bool:
        """Say how the engine ended; return whether it begins again by itself."""
        given_up = self._outbox.ended()
        now, outbox = time.monotonic(), self._outbox
        self._ends.append(now)
        often = len(self._ends) > _MOST_AGAIN and now - self._ends[0] <= _WITHIN_S
        self._is_down = self._failure is not None or not code or often
        self._tell_work(self._is_down)
        if self._failure is not None:
            return False  # that was told
        how = ending_words(code, self._plan.memory, ENGINE_LOG, self._log_from)
        if not self._is_down:
            self._publish(
                again_notice(
                    how, outbox.stopped_at, outbox.job, outbox.recording, named(outbox.edits), named(given_up), ENGINE_LOG
                )
            )  # fmt: skip
            self._publish(ProgressSnapshot("opening", _AGAIN))
            return True
        notice = down_notice(
            how, len(self._ends) if often else 1, named(outbox.edits), named(given_up), ENGINE_LOG
        )
        if not self._shown.is_set():
            self._failure = HandtrackError(notice.text)
            self._shown.set()
            self._opened.set()
        self._publish(ProgressSnapshot("failed", "The engine stays ended."))
        self._publish(notice)
        return False
