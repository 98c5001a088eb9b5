"""How much of what one client sends is let through: a steady rate; where more comes, the newest of each kind waits."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

RATE, BURST = 200.0, 400.0
"""messages a second, and at once. viser's page sends at most 20 values, 20 drags, 50 clicks and 50 cameras a second"""
MOST_READ, MOST_READ_AT_ONCE = 1000.0, 4000.0
"""as many are looked at; who sends more is sent away"""
MOST_BYTES, MOST_BYTES_AT_ONCE = 1e6, 4e6
"""of all that comes, pings too; the page sends at most some 30 kB a second"""
MOST_WAITING = 256
"""different things that wait; the page has about as many widgets"""


@dataclass
class Allowance:
    """A number of things allowed a second, and at once after a pause."""

    rate: float
    burst: float
    clock: Callable[[], float] = time.monotonic
    left: float = field(init=False)
    _then: float = field(init=False)

    def __post_init__(self) -> None:
        self.left, self._then = self.burst, self.clock()

    def take(self, amount: float = 1.0) -> bool:
        """Return whether so much more is allowed now, and count it."""
        if self.wait(amount) > 0:
            return False
        self.left -= amount
        return True

    def wait(self, amount: float = 1.0) -> float:
        """Return the seconds until so much more is allowed."""
        now = self.clock()
        self.left = min(self.burst, self.left + (now - self._then) * self.rate)
        self._then = now
        return max(0.0, (amount - self.left) / self.rate)


Message = bytes | Callable[[], None]
"""for viser; or what is to be done instead"""


class Flow:
    """The messages of one client on their way to viser."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._passing = Allowance(RATE, BURST, clock)
        self._reading = Allowance(MOST_READ, MOST_READ_AT_ONCE, clock)
        self._bytes = Allowance(MOST_BYTES, MOST_BYTES_AT_ONCE, clock)
        self._waiting: dict[Hashable, Message] = {}

    def heard(self) -> bool:
        """Count a message that came; return whether the client may go on sending."""
        return self._reading.take()

    def came(self, size: int) -> bool:
        """Count bytes that came; return whether the client may go on sending."""
        return self._bytes.take(size)

    def put(self, kind: Hashable, message: Message) -> bool:
        """Let a message wait in the place of the older one of its kind; return whether there was room."""
        if kind not in self._waiting and len(self._waiting) >= MOST_WAITING:
            return False
        self._waiting[kind] = message
        return True

    def take(self) -> Message | None:
        """Return the message that may pass now, None where none may."""
        if not self._waiting or not self._passing.take():
            return None
        return self._waiting.pop(next(iter(self._waiting)))

    def pause(self) -> float | None:
        """Return the seconds [s] until one may pass; None where none waits."""
        return self._passing.wait() if self._waiting else None
