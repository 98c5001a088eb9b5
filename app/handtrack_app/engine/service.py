"""What the services of an open session have in common; and what works beside the worker: jobs, and the thread that makes what is only shown."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import suppress
from typing import TYPE_CHECKING, Generic, TypeVar

from handtrack_app.protocol import Notice, Snapshot

if TYPE_CHECKING:
    from handtrack_app.engine.job_control import JobControl
    from handtrack_app.engine.open_session import OpenSession
import threading
from functools import partial

from handtrack.session.track_session import TrackingRequest
from handtrack.tracking.frame.control import Observer


class Service:
    """A part of an open session, which lives on the worker's thread."""

    def __init__(self, opened: OpenSession) -> None:
        self.opened, self.publish = opened, opened.publish
        self.document, self.store = opened.document, opened.store

    @property
    def jobs(self) -> JobControl:
        """What runs beside."""
        return self.opened.jobs


class FramePictures(ABC):
    """Pictures of the frame shown that the page wants, made on the render thread."""

    every_s, hurried_s = 0.0, 0.6
    """they are made at most this often, and this while tracking runs, which comes first"""
    _shown_at, _waits = 0.0, False

    @property
    @abstractmethod
    def is_wanted(self) -> bool:
        """Whether the page looks at something that there is."""

    @abstractmethod
    def _show(self, hurried: bool) -> None:
        """Have made what the page wants of the frame shown."""

    def show_soon(self) -> None:
        """Have made what the page wants of the frame shown, once no command waits (`show`) and it is time (`rest_s`)."""
        self._waits = True

    def rest_s(self, hurried: bool) -> float:
        """Return the seconds until it is time; infinite where nothing is to be made."""
        if not self._waits:
            return math.inf
        every_s = self.hurried_s if hurried else self.every_s
        return max(self._shown_at + every_s - time.monotonic(), 0.0)

    def show(self, hurried: bool = False) -> None:
        """Have made what the page wants of the frame shown. hurried: tracking runs."""
        self._waits = False
        if self.is_wanted:
            self._shown_at = time.monotonic()
            self._show(hurried)


# ---- A thread beside the worker: makes what is only shown (clouds, surfaces, pictures of them), or fits a frame anew


Made = TypeVar("Made")


class NewestFirst(Generic[Made]):
    """Makes things one after the other; of each kind only the newest order counts."""

    def __init__(self, take: Callable[[Made], None], name: str) -> None:
        """take: gets what is made, on the thread of this name."""
        self._take = take
        self._thread = ThreadPoolExecutor(1, name)
        self._newest: dict[str, Future[None]] = {}

    def stop(self) -> None:
        """Make no more after what is being made."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def ask(self, kind: str, make: Callable[[], Made | None]) -> None:
        """Have something made and taken; a waiting order of this kind is dropped."""
        if (before := self._newest.get(kind)) is not None:
            before.cancel()
        self._newest[kind] = self._thread.submit(self._serve, make)

    def wait_for(self, make: Callable[[], Made | None]) -> Made | None:
        """Have something made, and wait for it; None where it cannot be."""
        with suppress(CancelledError):
            return self._thread.submit(self._made, make).result()
        return None

    def _serve(self, make: Callable[[], Made | None]) -> None:
        if (made := self._made(make)) is not None:
            self._take(made)

    def _made(self, make: Callable[[], Made | None]) -> Made | None:
        return make()


class RenderThread(NewestFirst[Snapshot]):
    """Makes what is shown; what cannot be made is told."""

    def __init__(self, publish: Callable[[Snapshot], None]) -> None:
        super().__init__(publish, "render")
        self._said: Notice | None = None

    def _made(self, make: Callable[[], Snapshot | None]) -> Snapshot | None:
        try:
            return make()
        except Exception as error:
            notice = Notice.of_error(error, "That cannot be shown")
            if notice != self._said:  # the next frame would say the same
                self._said = notice
                self._take(notice)
        return None


# ---- Long work on its own thread: tracking, fitting the size, finding the hand. Posing never waits for a solver step


Work = Callable[["BackgroundJob"], None]
"""does a job; asks its `should_stop` between solver steps"""
Post = Callable[["BackgroundJob", Callable[[], None]], None]
"""has something done that a job reports, on the worker's thread"""


_STAGES = {"": "{}", "size": "Fitting the size: {}", "refine": "Refining all frames together …"}
"""what is shown of a stage"""
_GIVES_WAY_S = 0.3
"""that a job waits after each place to which somebody moves the hand; a page sends one every 0.05 s, and each is to be answered
before the next"""
_FIRST_STEPS, _ETA_SHARE = 3, 0.03
"""of a stage's progress: the steps that may compile or load caches, and the share after them that tells how long the rest takes.
Before, it would say minutes for seconds
"""


class BackgroundJob(Observer):
    """Works until done or cancelled; reports by what the worker is to do."""

    def __init__(
        self, kind: str, work: Work, post: Post, request: TrackingRequest | None, is_live: bool
    ) -> None:
        """request: of what is tracked or refined. is_live: running cameras do not wait."""
        self.kind, self.request = kind, request
        self.frames = range(0) if request is None else request.frames
        self.total = len(self.frames) if kind == "tracking" and not is_live else 0
        """frames to be done"""
        self.solved: set[int] = set()
        self.frame: int | None = None
        """done last"""
        self.begin_stage()
        self._began = self._held = time.monotonic()
        self._post, self.is_live = post, is_live
        self._stop, self._hold = threading.Event(), threading.Event()
        self._way_until = 0.0
        self._thread = threading.Thread(target=work, args=(self,), name=kind, daemon=True)

    @property
    def done(self) -> int:
        return len(self.solved)

    @property
    def paused(self) -> bool:
        return self._hold.is_set()

    @property
    def worked_s(self) -> float:
        """Seconds since it began, but for those in which it was held."""
        return (self._held if self.paused else time.monotonic()) - self._began

    def start(self) -> None:
        self._thread.start()

    def pause(self, on: bool) -> None:
        """Hold before the next solver step, or go on."""
        if on and not self.paused:
            self._held = time.monotonic()
            self._hold.set()
        elif self.paused and not on:
            self._began += time.monotonic() - self._held
            self._hold.clear()

    def give_way(self) -> None:
        """Wait a moment before the next solver step; not before running cameras."""
        if not self.is_live:
            self._way_until = time.monotonic() + _GIVES_WAY_S

    def cancel(self) -> None:
        """Ask the solver to stop at its next step."""
        self._stop.set()

    def join(self, timeout: float) -> None:
        if self._thread.is_alive():  # else it may not have begun
            self._thread.join(timeout)

    def eta_s(self) -> float:
        """Return the expected seconds left; 0 while unknown. What comes first, and may compile, does not count."""
        then, first = self._since
        gained = self.share - first
        if gained < _ETA_SHARE:
            return 0.0
        return (self.worked_s - then) / gained * (1.0 - self.share)

    def should_stop(self) -> bool:
        while self._hold.is_set() or time.monotonic() < self._way_until:
            if self._stop.wait(0.02):
                break
        return self._stop.is_set()

    @property
    def cancelled(self) -> bool:
        return self._stop.is_set()

    def report(self, take: Callable[..., None], *what: object) -> None:
        """Have something done with what came of the work, on the worker's thread."""
        self._post(self, partial(take, *what))

    def count(self, frame: int) -> None:
        """A frame is done, perhaps again."""
        self.solved.add(frame)
        self.frame = frame
        if self.total:
            self.progress(self.done / self.total, stage="")

    def begin_stage(self, stage: str = "") -> None:
        """Begin another stage; the time that is left is that of a stage. stage: as of `progress`."""
        self.stage, self.share, self.words = stage, 0.0, ""
        self._steps, self._since = 0, (0.0, 0.0)
        """how often the share grew; when the last of the first times was, and to which"""

    def progress(self, share: float, words: str = "", stage: str = "refine") -> None:
        """Take how far a stage is: the share that is done, 0 to 1, and what is done in words. stage: nothing where frames are counted."""
        if stage != self.stage:
            self.begin_stage(stage)
        if self._steps < _FIRST_STEPS and share > self.share:
            self._steps, self._since = self._steps + 1, (self.worked_s, share)
        self.share, self.words = share, _STAGES[stage].format(words)
