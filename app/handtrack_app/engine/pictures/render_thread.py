"""The render thread: makes beside the worker what is only shown: clouds, surfaces, pictures of them."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass

from handtrack.errors import HandtrackError
from handtrack_app.protocol.mailbox import Mailbox
from handtrack_app.protocol.snapshots import Notice, Snapshot

log = logging.getLogger(__name__)
Make = Callable[[], Snapshot | None]


@dataclass(frozen=True, eq=False)
class _Order:
    kind: str
    make: Make


class RenderThread:
    """Makes snapshots one after the other; of each kind only the newest order counts."""

    def __init__(self, publish: Callable[[Snapshot], None]) -> None:
        self._publish = publish
        self._mail: Mailbox[_Order] = Mailbox(lambda order: order.kind)
        self._stopping = threading.Event()
        self._said: Notice | None = None
        self._thread = threading.Thread(target=self._work, name="render", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self, timeout: float = 5.0) -> None:
        """End the thread, after what it is making."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(timeout)

    def ask(self, kind: str, make: Make) -> None:
        """Have something made and published; a waiting order of this kind is dropped."""
        self._mail.put(_Order(kind, make))

    def wait_for(self, kind: str, make: Make) -> Snapshot | None:
        """Have something made, and wait for it; None where it cannot be."""
        made, done = list[Snapshot | None](), threading.Event()

        def make_and_tell() -> None:
            try:
                made.append(make())
            finally:
                done.set()

        self.ask(f"{kind}, waited for", make_and_tell)
        while not done.wait(0.1):
            if self._stopping.is_set():
                return None
        return made[0] if made else None

    def _work(self) -> None:
        while not self._stopping.is_set():
            order = self._mail.take(0.2)
            if order is not None:
                self._serve(order)

    def _serve(self, order: _Order) -> None:
        try:
            snapshot = order.make()
        except HandtrackError as error:
            self._say(Notice("error", "That cannot be shown", str(error)))
        except Exception as error:  # the page must go on, and the user must know
            log.exception("could not make %s", order.kind)
            self._say(Notice.of_mistake(error))
        else:
            if snapshot is not None:
                self._publish(snapshot)

    def _say(self, notice: Notice) -> None:
        if notice != self._said:  # the next frame would say the same
            self._said = notice
            self._publish(notice)
