"""Playback at the recording's pace, and the demo: the session tracks itself, then plays."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from handtrack_app.page.page import Page
from handtrack_app.page.state import UserState
from handtrack_app.protocol.commands import Track
from handtrack_app.protocol.snapshots import ProgressSnapshot, SessionSnapshot, TimelineSnapshot


class Player:
    """A clock on its own thread. It asks for frames; frames that come too late are skipped."""

    def __init__(
        self,
        state: UserState,
        go_to: Callable[[float], None],
        ended: Callable[[], None] = lambda: None,
    ) -> None:
        """ended: called when playback ends, or whoever edits has ended it."""
        self.fps = 25.0
        self._state, self._go_to, self._ended = state, go_to, ended
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
            if not state.playing:
                continue
            began, first = time.monotonic(), state.frame
            if first >= state.stop - 1:
                first = state.start
            last_asked = -1
            pace = self.fps * state.speed
            while state.playing and pace == self.fps * state.speed and not self._stopping.is_set():
                due = first + int((time.monotonic() - began) * pace)
                if due > state.stop - 1:
                    began, first, due = time.monotonic(), state.start, state.start
                if due != last_asked:
                    last_asked = due
                    with state.lock:  # an edit that begins now comes first, and ends it
                        if state.playing:
                            self._go_to(due)
                time.sleep(0.4 / max(pace, 1.0))
            if not state.playing:
                self._ended()


class Demo:
    """Watches what the page shows, and presses the buttons that a new user would."""

    def __init__(self) -> None:
        self._begun = self._waits = self._tracking = False

    def begin(self, strip: TimelineSnapshot, page: Page, session: SessionSnapshot | None) -> None:
        """Track all frames once the session is shown; play what was tracked the last time."""
        if self._begun or session is None:
            return
        self._begun = True
        if (strip.status >= 0).any():
            page.state.playing = True
            return
        page.state.follow = self._waits = True
        page.send(Track(session.start, session.stop, session.first_frame, anew=True))

    def follow(self, progress: ProgressSnapshot, page: Page) -> None:
        """Play once when what it began to track is done, unless the user looks at something else by then."""
        if not self._waits:
            return
        if progress.state == "tracking":
            self._tracking = True
        elif self._tracking and progress.state == "idle":
            self._tracking = self._waits = False
            page.state.playing = page.state.follow
