"""Playback at the recording's pace."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from handtrack_app import viser_internals as internals
from handtrack_app.page.page import Page, UserState

_MOST = 2
"""frames under way: one is made while one is drawn"""
_QUESTION = "handtrack.drawn"
_TIMES = 2
"""the page answers as it takes what it is told; when it answers again, it has drawn that, and loaded the pictures"""


@dataclass(frozen=True)
class Drawn:
    """A page has drawn the frame that it was told last."""


class InFlight:
    """Frames that are played and that no page has drawn yet: a slow page gets fewer, each of them whole.

    A page tells by answering a question that comes behind all that is of the frame: what its browser keeps under a name. The one that
    answers first counts: another may lie in a hidden tab, where it draws nothing.
    """

    def __init__(self, page: Page, drawn: Callable[[Drawn], None]) -> None:
        """drawn: is told when the page has drawn a frame."""
        self._page, self._report = page, drawn
        self._frames = deque[int]()
        self._drawing: int | None = None
        self._question, self._times = "", 0
        """asked last, and how often for the frame; empty once it is answered"""
        self._count = 0
        self._lock = threading.Lock()
        internals.on_storage(page.server, self._answered)

    @property
    def has_room(self) -> bool:
        """Whether another frame may be asked for."""
        return len(self._frames) < _MOST

    @property
    def is_watched(self) -> bool:
        """Whether a page is there to see what is played."""
        return bool(self._page.clients)

    @property
    def is_drawing(self) -> bool:
        """Whether a frame was told and is not drawn yet: the next one waits for that."""
        return self._drawing is not None

    def begin(self, frame: int) -> None:
        """A frame is asked for."""
        with self._lock:
            self._frames.append(frame)

    def clear(self) -> None:
        """Wait for none of them any more."""
        with self._lock:
            self._frames.clear()
            self._drawing = None

    def show(self, frame: int) -> None:
        """All that is of a frame was told: ask the pages, behind it. Where there is none, nobody is waited for."""
        if not self.is_watched:
            self._drawn(frame)
            return
        with self._lock:
            self._drawing = frame
        self._ask(1)

    def _ask(self, times: int) -> None:
        with self._lock:
            self._count += 1
            question = f"drawn {self._count % 8}"  # viser keeps one of each for those who come
            self._question, self._times = question, times
        asked = internals.messages.LocalStorageGetItemRequestMessage(_QUESTION, question)
        internals.send(self._page.server, asked)

    def _answered(self, question: str) -> None:
        with self._lock:
            frame, times = self._drawing, self._times
            if question != self._question or frame is None:
                return
            self._question = ""
        if times < _TIMES:
            self._ask(times + 1)
        else:
            self._drawn(frame)

    def _drawn(self, frame: int) -> None:
        with self._lock:
            self._drawing = None
            while frame in self._frames:  # those before it gave way to it
                if self._frames.popleft() == frame:
                    break
        self._report(Drawn())


class Player:
    """A clock on its own thread. It asks for frames; frames that come too late are skipped."""

    def __init__(
        self,
        state: UserState,
        ask: Callable[[int], None],
        in_flight: InFlight,
        ended: Callable[[], None],
    ) -> None:
        """ask: for a frame with all that is of it. ended: called when playback ends, or an edit has ended it."""
        self.fps = 25.0
        self._state, self._ask, self._in_flight, self._ended = state, ask, in_flight, ended
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._work, name="player", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stopping.set()
        self._thread.join(2.0)

    def _work(self) -> None:
        state = self._state
        while not self._stopping.wait(0.03):
            if not (state.playing and self._in_flight.is_watched):
                continue  # a page left open, and closed, is no work for anybody
            began, first = time.monotonic(), state.frame
            if first >= state.strip.stop - 1:
                first = state.strip.start
            last_asked = -1
            self._in_flight.clear()
            pace = self.fps * state.speed
            while (
                state.playing
                and self._in_flight.is_watched
                and pace == self.fps * state.speed
                and not self._stopping.is_set()
            ):
                due = first + int((time.monotonic() - began) * pace)
                if due > state.strip.stop - 1:
                    first = due = state.strip.start
                    began = time.monotonic()
                if due != last_asked and self._in_flight.has_room:
                    last_asked = due
                    with state.lock:  # an edit that begins now comes first, and ends it
                        if state.playing:
                            self._ask(due)
                time.sleep(0.4 / max(pace, 1.0))
            if not state.playing:
                self._ended()
