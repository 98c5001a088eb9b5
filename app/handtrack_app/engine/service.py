"""What the services of an open session have in common: what they work on, how what they change is shown, and the thread that makes what is only shown."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import suppress
from typing import TYPE_CHECKING, Generic, TypeVar

from handtrack_app.protocol.snapshots import Notice, Snapshot

if TYPE_CHECKING:
    from handtrack_app.engine.job_control import JobControl
    from handtrack_app.engine.open_session import OpenSession


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
