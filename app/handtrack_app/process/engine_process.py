"""The engine in a process of its own: when it dies, the page lives on, says so, and goes on with a new one."""

from __future__ import annotations

import logging
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, cast
from uuid import uuid4

from handtrack.errors import HandtrackError
from handtrack_app.log import ENGINE_LOG
from handtrack_app.process.child import GB, EngineChild, EnginePlan
from handtrack_app.protocol import (
    Call,
    Caller,
    Commands,
    Engine,
    LiveSnapshot,
    Notice,
    Opened,
    PoseSnapshot,
    ProgressSnapshot,
    Snapshot,
    WorkSnapshot,
)

_CRASHES = {"SIGSEGV", "SIGBUS", "SIGILL", "SIGFPE", "SIGABRT", "SIGSYS", "SIGTRAP"}


def ending_words(code: int, memory: int | None) -> str:
    """Return how the engine's process ended, in a sentence.

    code: its exit code, or the number of a signal below 0. memory: what it was allowed [bytes].
    """
    limit = "" if memory is None else f" It may use {memory / GB:.1f} GB (--memory)."
    names = {-one: one.name for one in signal.Signals}
    name = names.get(code, f"signal {-code}") if code < 0 else ""
    if name == "SIGKILL":
        return f"The engine was ended from outside (SIGKILL), as the system does when memory runs out.{limit}"
    if name in _CRASHES or code > 0:
        how = f"crashed ({name})" if name else f"ended with exit code {code}"
        return f"The engine {how}: an error in handtrack or a library, or a lack of memory.{limit}"
    if code == 0:
        return "The engine was asked to end (SIGTERM), by a person or a memory guard."
    return f"The engine was ended from outside ({name})."


_BEGINS_AGAIN = (
    "The engine was ended",
    "It restarts from the saved state.",
    " Not on disk yet, and done again now: {}.",
)
_STAYS_ENDED = (
    "The engine stays ended",
    "It does not restart by itself: 'Start again' (at the top) opens what is on disk.",
    " Not on disk yet: {}; done again then.",
)


def end_notice(how: str, outbox: Outbox, given_up: list[Call]) -> Notice:
    """Return what the user is told when the engine ended. outbox: what is done again; given_up: what is not."""
    title, then, unwritten = _STAYS_ENDED if outbox.is_down else _BEGINS_AGAIN
    text, job = f"{how} {then}", outbox.job
    text += unwritten.format(edits) if (edits := outbox.words) else ""
    text += f" Given up: {named(given_up)}." if given_up else ""
    if outbox.stopped_at is not None:
        text += f" Tracking stopped at frame {outbox.stopped_at}; there, 'From here' (tab Track) goes on."
    elif job and job != "tracking":
        text += f" The running job was interrupted ({job}); start it again."
    if outbox.recording:
        text += f" The recording in {outbox.recording} was interrupted: its videos are there, its session.toml is not."
    return Notice("error", title, f"{text} Details: {ENGINE_LOG}")


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
        self._telling = threading.RLock()
        """of what is found and told in one: else `saved` could be told after the `saving` that came later"""
        self.engine = cast("Engine", Caller(self.call))
        """what the page calls; each call returns at once"""
        self._shown, self._opened = threading.Event(), threading.Event()
        self._stopping, self._again = threading.Event(), threading.Event()
        self._failure: Exception | None = None
        self._ends: deque[float] = deque(maxlen=_MOST_AGAIN + 1)
        self._life: EngineChild | None = None
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
            self._publish_work()
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
        if not self._outbox.is_down and self._failure is None and self._thread.is_alive():
            self._outbox.wait_done(timeout)
        self._stopping.set()
        self._again.set()
        life = self._life
        if life is not None:  # its pipe may be full, with nobody at the other end
            threading.Thread(target=life.send, args=(timeout,), daemon=True).start()
        self._thread.join(2 * timeout)
        if life is not None and self._thread.is_alive():
            life.kill()
            self._thread.join(timeout)
        if lost := self._outbox.words:
            self.last_words.append(f"Not saved, since the engine did not answer: {lost}.")

    # ---- on the engine's thread

    def _live(self) -> None:
        plan = self._plan
        while not self._stopping.is_set():
            try:
                code = self._one_life(plan)
            except OSError:  # the system starts no more processes
                log.exception("no engine could be started")
                code = 1
            if not self._stopping.is_set() and not self._report_end(code):
                self._again.wait()  # perhaps it was asked for before the process had ended
                self._again.clear()
                self._failure = None
                self._publish_work(is_down=False)
                self._ends.clear()
            plan = replace(plan, preview=False, take_over=False, version=self._outbox.version)

    def _one_life(self, plan: EnginePlan) -> int:
        """Let a process be the engine; return how it ended."""
        child, self._child = self._child or EngineChild(ENGINE_LOG), None
        self._life = child
        if self._stopping.is_set():  # which saw no life yet
            child.kill()
        child.send(plan)
        code = child.listen(lambda message: self._take(child, message, plan is not self._plan))
        self._life = None
        return code

    def _take(self, child: EngineChild, message: object, is_anew: bool) -> None:
        if isinstance(message, dict):
            self._outbox.commands = message
        elif isinstance(message, Opened) and not message.is_whole:
            self._failure = message.failure
            self._outbox.listen(is_anew)
            self._shown.set()
        elif isinstance(message, Opened):
            self._failure = message.failure
            self._opened.set()
            if message.failure is not None:
                child.send(1.0)
        elif isinstance(message, list):
            self.last_words = message
        else:
            with self._telling:
                if (text := self._outbox.see(cast("Snapshot", message))) is not None:
                    self._publish(text)

    def _publish_work(self, is_down: bool | None = None) -> None:
        """Say where what is saved is not as it was said last."""
        with self._telling:
            if (work := self._outbox.work(is_down)) is not None:
                self._publish(work)

    def _report_end(self, code: int) -> bool:
        """Say how the engine ended; return whether it begins again by itself."""
        given_up = self._outbox.ended()
        now, outbox = time.monotonic(), self._outbox
        self._ends.append(now)
        often = len(self._ends) > _MOST_AGAIN and now - self._ends[0] <= _WITHIN_S
        self._publish_work(self._failure is not None or not code or often)
        if self._failure is not None:
            return False  # that was told
        how = ending_words(code, self._plan.memory)
        if often:
            how += f" That was {len(self._ends)} times within a minute."
        notice = end_notice(how, outbox, given_up)
        if not outbox.is_down:
            self._publish(notice)
            self._publish(ProgressSnapshot("opening", _AGAIN))
            return True
        if not self._shown.is_set():
            self._failure = HandtrackError(notice.text)
            self._shown.set()
            self._opened.set()
        self._publish(ProgressSnapshot("failed", "The engine stays ended."))
        self._publish(notice)
        return False


# ---- Calls of the page that the engine has not reported as on disk: kept in order, and repeated to an engine that begins again


_MOST = 1000  # calls that wait: nobody presses so many while an engine begins
_MOST_SENT = 64  # calls under way: a pipe that nobody reads must not fill, or the page's callbacks would wait
_MOST_ENDS = 2  # engines that end while they serve one call alone: that call ends them
_AT_WORK = ("tracking", "paused")


@dataclass
class Outbox:
    """Any thread may ask. `send` hands a call to the engine's pipe; it is called in order, one call at a time."""

    send: Callable[[Call], None]
    version: int = 0
    """of the user's newest edit when the engine of now began"""
    stopped_at: int | None = None
    """the frame tracked last, while tracking runs"""
    job: str = ""
    """what the engine is at, while a job runs"""
    recording: str = ""
    """the folder that running cameras are recorded to"""
    commands: Commands = field(default_factory=dict)
    """the engine's; it tells them before anything else, so none is called before"""
    is_down: bool = False
    """the engine stays ended"""
    _newest: int = 0
    _number: int = 0
    _is_listening: bool = False
    _kept: list[Call] = field(default_factory=list)
    """in the order of their numbers; they are sent, done and written in that order, so one number says how far each has come"""
    _sent: int = 0
    """to the engine of now, up to this number"""
    _done: int = 0
    """by the engine of now, if not on disk yet"""
    _repeated: int = 0
    """sent to an engine before"""
    _ends: Counter[int] = field(default_factory=Counter)
    """by a call's number the engines that ended while they served it alone"""
    _views: dict[str, Call] = field(default_factory=dict)
    _frame: int | None = None
    _frame_done: int | None = None
    """that was shown before the oldest call that is kept"""
    _work: WorkSnapshot | None = None
    _reported: WorkSnapshot | None = None
    _changed: threading.Condition = field(default_factory=threading.Condition)

    # ---- from the page

    def put(self, name: str, given: tuple[Any, ...], named: Mapping[str, Any]) -> Call | None:
        """Send a call, or keep it until it can be sent; return one that nobody serves. While the engine stays ended, edits alone
        are kept. Raises TypeError for what the engine does not have.
        """
        with self._changed:
            call = Call.of(self.commands, name, given, named)
            if call.command.view:
                self._views[name] = call
            if self.is_down and not call.command.edits:
                return call if call.command.job else None
            if not call.is_kept:
                if self._is_listening:
                    self.send(call)
                return None
            self._replace(call)
            if len(self._kept) >= _MOST:
                return call
            self._number += 1
            self._kept.append(replace(call, number=self._number))
            self._newest = max(self._newest, call.arguments.get("version", 0))
            self._send_waiting()
            return None

    def _replace(self, call: Call) -> None:
        """Drop the waiting call that this one replaces; one that is sent was perhaps done, and is replaced by the next of the same
        drag only.
        """
        key, tag, between = call.key, call.arguments.get("tag", ""), False
        for place in range(len(self._kept) - 1 if key is not None else -1, -1, -1):
            old = self._kept[place]
            is_sent = old.number <= self._sent
            follows = not between and old.arguments.get("tag", "") == tag
            if old.key == key and (follows or not is_sent):
                del self._kept[place]
                return
            if is_sent or old.is_step:
                return
            between = True

    # ---- to the engine

    def listen(self, is_anew: bool) -> None:
        """The engine serves calls from now on. is_anew: it is told first what the page looks at."""
        with self._changed:
            self._is_listening = True
            frame = self._frame_done if self._kept else self._frame
            for view in self._views.values():
                self.send(view)
            if is_anew and frame is not None:
                self.send(Call.of(self.commands, "show_frame", (frame,), {}))
            self._send_waiting()

    def _send_waiting(self) -> None:
        while self._is_listening:
            under_way = [c.number for c in self._kept if self._done < c.number <= self._sent]
            call = next((c for c in self._kept if c.number > self._sent), None)
            if call is None or len(under_way) >= _MOST_SENT:
                return
            if under_way and under_way[0] <= self._repeated:
                return  # it may have ended the engine before: such calls are served one by one
            self._sent = call.number
            if call.arguments.get("version", self.version) < self.version:
                # the engine passes over poses that are older than what it was told of
                call = replace(call, arguments={**call.arguments, "version": self.version})
            self.send(call)

    def ended(self) -> list[Call]:
        """The engine ended: what it had not done is to be repeated. Return what is given up: jobs that it may have begun, and the
        call with which it ended again and again.
        """
        with self._changed:
            self.version, self._is_listening = self._newest, False
            sent = [call for call in self._kept if call.number <= self._sent]
            given_up = [call for call in sent if call.command.job]
            again = (call for call in sent if not call.command.job)
            alone = next((c for c in again if self._done < c.number <= self._repeated), None)
            if alone is not None:
                self._ends[alone.number] += 1
                if self._ends[alone.number] >= _MOST_ENDS:
                    given_up.append(alone)
            self._repeated = max(self._repeated, self._sent)
            self._sent = self._done = 0
            gone = {call.number for call in given_up}
            self._kept = [call for call in self._kept if call.number not in gone]
            self._changed.notify_all()
            return given_up

    # ---- from the engine

    def see(self, snapshot: Snapshot) -> Snapshot | None:
        """The engine reports this; return what the page is to be told."""
        with self._changed:
            if isinstance(snapshot, PoseSnapshot):
                if self._is_listening:  # an engine that begins shows its first frame
                    self._frame = snapshot.frame
                    if not self._kept:
                        self._frame_done = snapshot.frame
            elif isinstance(snapshot, LiveSnapshot):
                self.recording = snapshot.recording
            elif isinstance(snapshot, ProgressSnapshot) and snapshot.state != "opening":
                self.stopped_at = snapshot.frame if snapshot.state in _AT_WORK else None
                self.job = snapshot.job if snapshot.state != "idle" else ""
            elif isinstance(snapshot, WorkSnapshot):
                self._work = snapshot
                self._done = snapshot.done
                for call in self._kept:
                    if call.number <= snapshot.written and call.name == "show_frame":
                        self._frame_done = call.arguments["frame"]
                self._kept = [call for call in self._kept if call.number > snapshot.written]
                self._send_waiting()
                self._changed.notify_all()
                return self._news()
            return snapshot

    def work(self, is_down: bool | None = None) -> WorkSnapshot | None:
        """Return what is new of what is saved: `saved` is all that was called, and no less. is_down: whether the engine stays ended."""
        with self._changed:
            self.is_down = self.is_down if is_down is None else is_down
            return self._news()

    def _news(self) -> WorkSnapshot | None:
        if self._work is None:
            return None
        saved = self._work.saved
        if saved == "saved" and self._edits:
            saved = "unsaved" if self.is_down else "saving"
        now = replace(self._work, saved=saved, written=0, done=0)
        if now == self._reported:
            return None
        self._reported = now
        return now

    # ---- what is not on disk

    @property
    def _edits(self) -> list[Call]:
        return [call for call in self._kept if call.command.edits]

    @property
    def edits(self) -> list[Call]:
        """The edits that are not known to be on disk, in order."""
        with self._changed:
            return self._edits

    @property
    def words(self) -> str:
        """What these are about."""
        return named(self.edits)

    def wait_done(self, timeout: float) -> None:
        """Wait until all edits are on disk, a while at most."""
        until = time.monotonic() + timeout
        with self._changed:
            while self._edits and (left := until - time.monotonic()) > 0:
                self._changed.wait(left)


def named(calls: Iterable[Call]) -> str:
    """Return what calls are about, in words: what may be lost is named."""
    counts = Counter(call.words for call in calls)
    return ", ".join(f"{words} ({n} times)" if n > 1 else words for words, n in counts.items())
