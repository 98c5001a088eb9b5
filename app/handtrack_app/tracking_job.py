"""Tracking on its own thread: posing and drawing never wait for a solver step."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from handtrack.arrays import Floats
from handtrack.errors import HandtrackError
from handtrack.tracker.result import FrameResult

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Tracked:
    """One more frame is done."""

    job: int
    result: FrameResult


@dataclass(frozen=True)
class Ended:
    """The job is over; `error` says why, if not as asked."""

    job: int
    cancelled: bool
    error: str = ""
    internal: bool = False


class TrackingJob:
    """Tracks frames until done, cancelled, or failed; posts Tracked and at last Ended."""

    def __init__(
        self,
        number: int,
        run: Any,
        frames: range,
        first: int,
        params: Floats,
        post: Callable[[Tracked | Ended], None],
    ) -> None:
        self.number, self.frames, self.first = number, frames, first
        self.done, self.began, self.waited = 0, time.monotonic(), 0.0
        self._first_done = self.began
        self._run, self._params, self._post = run, params, post
        self._stop, self._hold = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work, name="tracking", daemon=True)

    @property
    def paused(self) -> bool:
        return self._hold.is_set()

    def start(self) -> None:
        self._thread.start()

    def pause(self, on: bool) -> None:
        """Hold before the next solver step, or go on."""
        (self._hold.set if on else self._hold.clear)()

    def cancel(self) -> None:
        """Ask the solver to stop at its next step."""
        self._stop.set()

    def join(self, timeout: float) -> None:
        self._thread.join(timeout)

    def eta_s(self) -> float:
        """Return the expected seconds left; 0 while unknown. The first frame, which may compile, does not count."""
        if self.done < 2:
            return 0.0
        spent = time.monotonic() - self._first_done - self.waited
        return spent / (self.done - 1) * (len(self.frames) - self.done)

    def _should_stop(self) -> bool:
        if self._hold.is_set():
            held = time.monotonic()
            while self._hold.is_set() and not self._stop.wait(0.02):
                pass
            self.waited += time.monotonic() - held
        return self._stop.is_set()

    def _work(self) -> None:
        error, internal = "", False
        try:
            for result in self._run.track(self.frames, self.first, self._params, self._should_stop):
                self.done += 1
                if self.done == 1:
                    self._first_done, self.waited = time.monotonic(), 0.0
                self._post(Tracked(self.number, result))
                if self._should_stop():
                    break
        except HandtrackError as problem:
            error = str(problem)
        except Exception as problem:  # reported to the user: the page must go on
            log.exception("tracking failed")
            error, internal = f"{type(problem).__name__}: {problem}", True
        self._post(Ended(self.number, self._stop.is_set(), error, internal))
