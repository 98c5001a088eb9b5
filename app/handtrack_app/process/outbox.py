"""Calls of the page that the engine has not reported as on disk: kept in order, and repeated to an engine that begins again."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from handtrack_app.protocol.calls import Call, Rules
from handtrack_app.protocol.snapshots import (
    LiveSnapshot,
    PoseSnapshot,
    ProgressSnapshot,
    Snapshot,
    WorkSnapshot,
)

_MOST = 1000  # calls that wait: nobody presses so many while an engine begins
_MOST_SENT = 64  # calls under way: a pipe that nobody reads must not fill, or the page's callbacks would wait
_MOST_ENDS = 2  # engines that end while they serve one call alone: that call ends them
_AT_WORK = ("tracking", "paused")


@dataclass
class _Entry:
    call: Call
    is_sent: bool = False
    """to the engine of now"""
    is_repeated: bool = False
    """it was sent to one before"""
    is_done: bool = False
    """by the engine of now, if not on disk yet"""
    ends: int = 0
    """engines that ended while they served this alone"""


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
    rules: Rules = field(default_factory=dict)
    """the engine's commands; empty until it has told them"""
    _newest: int = 0
    _number: int = 0
    _is_listening: bool = False
    _is_down: bool = False
    _early: list[tuple[str, tuple[Any, ...], Mapping[str, Any]]] = field(default_factory=list)
    """calls made before the rules were known"""
    _kept: list[_Entry] = field(default_factory=list)
    _views: dict[str, Call] = field(default_factory=dict)
    _frame: int | None = None
    _frame_done: int | None = None
    """that was shown before the oldest call that is kept"""
    _work: WorkSnapshot | None = None
    _told: WorkSnapshot | None = None
    _changed: threading.Condition = field(default_factory=threading.Condition)

    # ---- from the page

    def put(self, name: str, given: tuple[Any, ...], named: Mapping[str, Any]) -> Call | None:
        """Send a call, or keep it until it can be sent; return one that nobody serves. While the engine stays ended, edits alone
        are kept. Raises TypeError for what the engine does not have.
        """
        with self._changed:
            if not self.rules:
                self._early.append((name, given, named))
                return None
            call = Call.of(self.rules, name, given, named)
            if call.rule.view:
                self._views[name] = call
            if self._is_down and not call.rule.edits:
                return call if call.rule.job else None
            if not call.is_kept:
                if self._is_listening:
                    self.send(call)
                return None
            self._replace(call)
            if len(self._kept) >= _MOST:
                return call
            self._number += 1
            self._kept.append(_Entry(replace(call, number=self._number)))
            self._newest = max(self._newest, call.arguments.get("version", 0))
            self._send_waiting()
            return None

    def _replace(self, call: Call) -> None:
        """Drop the waiting call that this one replaces; one that is sent was perhaps done, and is replaced by the next of the same
        drag only.
        """
        key, tag, between = call.key, call.arguments.get("tag", ""), False
        for place in range(len(self._kept) - 1 if key is not None else -1, -1, -1):
            entry = self._kept[place]
            follows = not between and entry.call.arguments.get("tag", "") == tag
            if entry.call.key == key and (follows or not entry.is_sent):
                del self._kept[place]
                return
            if entry.is_sent or entry.call.is_step:
                return
            between = True

    # ---- to the engine

    def know(self, rules: Rules) -> None:
        """The engine tells its commands."""
        with self._changed:
            self.rules, early = rules, self._early
            self._early = []
        for name, given, named in early:
            self.put(name, given, named)

    def listen(self, is_anew: bool) -> None:
        """The engine serves calls from now on. is_anew: it is told first what the page looks at."""
        with self._changed:
            self._is_listening = True
            frame = self._frame_done if self._kept else self._frame
            for view in self._views.values():
                self.send(view)
            if is_anew and frame is not None:
                self.send(Call.of(self.rules, "show_frame", (frame,), {}))
            self._send_waiting()

    def _send_waiting(self) -> None:
        while self._is_listening:
            under_way = [e for e in self._kept if e.is_sent and not e.is_done]
            waiting = next((e for e in self._kept if not e.is_sent), None)
            if waiting is None or len(under_way) >= _MOST_SENT:
                return
            if any(e.is_repeated for e in under_way):
                return  # it may have ended the engine before: such calls are served one by one
            waiting.is_sent = True
            call = waiting.call
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
            sent = [entry for entry in self._kept if entry.is_sent]
            given_up = [entry for entry in sent if entry.call.rule.job]
            again = [entry for entry in sent if not entry.call.rule.job]
            for entry in [e for e in again if e.is_repeated and not e.is_done][:1]:
                entry.ends += 1
                if entry.ends >= _MOST_ENDS:
                    given_up.append(entry)
            for entry in again:
                entry.is_sent, entry.is_done, entry.is_repeated = False, False, True
            self._kept = [entry for entry in self._kept if entry not in given_up]
            self._changed.notify_all()
            return [entry.call for entry in given_up]

    # ---- from the engine

    def see(self, snapshot: Snapshot) -> Snapshot | None:
        """The engine reports this; return what the page is to be told."""
        with self._changed:
            if isinstance(snapshot, PoseSnapshot):
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
                self._done(snapshot.done, snapshot.written)
                return self._news()
            return snapshot

    def _done(self, done: int, written: int) -> None:
        for entry in self._kept:
            entry.is_done = entry.is_done or (entry.is_sent and entry.call.number <= done)
            if entry.call.number <= written and entry.call.name == "show_frame":
                self._frame_done = entry.call.arguments["frame"]
        self._kept = [entry for entry in self._kept if entry.call.number > written]
        self._send_waiting()
        self._changed.notify_all()

    def work(self, is_down: bool | None = None) -> WorkSnapshot | None:
        """Return what is new of what is saved: `saved` is all that was called, and no less. is_down: whether the engine stays ended."""
        with self._changed:
            self._is_down = self._is_down if is_down is None else is_down
            return self._news()

    def _news(self) -> WorkSnapshot | None:
        if self._work is None:
            return None
        saved = self._work.saved
        if saved == "saved" and self._edits:
            saved = "unsaved" if self._is_down else "saving"
        now = replace(self._work, saved=saved, written=0, done=0)
        if now == self._told:
            return None
        self._told = now
        return now

    # ---- what is not on disk

    @property
    def _edits(self) -> list[Call]:
        return [entry.call for entry in self._kept if entry.call.rule.edits]

    @property
    def edits(self) -> list[Call]:
        """The edits that are not known to be on disk, in order."""
        with self._changed:
            return self._edits

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
