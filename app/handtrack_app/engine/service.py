"""What the services of an open session have in common: what they work on, how what they change is shown, and the thread that makes what is only shown."""

from __future__ import annotations

import math
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Generic, TypeVar

from handtrack.session.session_state import Edit
from handtrack_app.protocol.calls import Mailbox
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

    def _do(
        self, words: str, edit: Callable[[], Edit], tag: str = "", is_stroke: bool = False
    ) -> None:
        """Make an edit of settings."""
        with self.opened.changing():
            self.store.do(words, edit(), tag, is_stroke=is_stroke)


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
        self._mail: Mailbox[tuple[str, Callable[[], Made | None]]] = Mailbox(lambda order: order[0])
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self, timeout: float = 5.0) -> None:
        """End the thread, after what it is making."""
        self._stopping.set()
        self._mail.close()
        if self._thread.is_alive():
            self._thread.join(timeout)

    def ask(self, kind: str, make: Callable[[], Made | None]) -> None:
        """Have something made and taken; a waiting order of this kind is dropped."""
        self._mail.put((kind, make))

    def wait_for(self, kind: str, make: Callable[[], Made | None]) -> Made | None:
        """Have something made, and wait for it; None where it cannot be."""
        made, done = list[Made | None](), threading.Event()

        def make_and_signal() -> None:
            try:
                made.append(make())
            finally:
                done.set()

        self.ask(f"{kind}, waited for", make_and_signal)
        while not done.wait(0.1):
            if self._stopping.is_set():
                return None
        return made[0] if made else None

    def _work(self) -> None:
        while not self._stopping.is_set():
            order = self._mail.take(0.2)
            if order is not None:
                self._serve(*order)

    def _serve(self, kind: str, make: Callable[[], Made | None]) -> None:
        made = make()
        if made is not None:
            self._take(made)


class RenderThread(NewestFirst[Snapshot]):
    """Makes what is shown; what cannot be made is told."""

    def __init__(self, publish: Callable[[Snapshot], None]) -> None:
        super().__init__(publish, "render")
        self._said: Notice | None = None

    def _serve(self, kind: str, make: Callable[[], Snapshot | None]) -> None:
        try:
            super()._serve(kind, make)
        except Exception as error:
            notice = Notice.of_error(error, "That cannot be shown")
            if notice != self._said:  # the next frame would say the same
                self._said = notice
                self._take(notice)
