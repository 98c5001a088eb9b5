"""Playback: advances the frame at the recording's pace while the user wants it to."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from handtrack_app.page.state import UserState


class Player:
    """A clock on its own thread. It asks for frames; frames that come too late are skipped."""

    def __init__(self, state: UserState, go_to: Callable[[float], None]) -> None:
        self.fps = 25.0
        self._state, self._go_to = state, go_to
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
                    self._go_to(due)
                time.sleep(0.4 / max(pace, 1.0))
