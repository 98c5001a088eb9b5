"""What two processes tell each other, message by message, over a pair of pipes."""

from __future__ import annotations

import pickle
import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias

if TYPE_CHECKING:
    from handtrack_app.protocol.snapshots import Snapshot


@dataclass(frozen=True)
class Stop:
    """To the engine: keep the last edits and end."""

    timeout: float
    """[s] for each of its threads"""


@dataclass(frozen=True)
class Shown:
    """From the engine: there is something to be looked at, or why not."""

    failure: Exception | None


@dataclass(frozen=True)
class Opened:
    """From the engine: the session can be worked in, or why not."""

    failure: Exception | None


@dataclass(frozen=True)
class Ended:
    """From the engine: its last message."""

    last_words: tuple[str, ...]


FromEngine: TypeAlias = "Snapshot | Shown | Opened | Ended"


class Channel:
    """One end. Any thread may send; one receives."""

    def __init__(self, incoming: BinaryIO, outgoing: BinaryIO) -> None:
        self._incoming, self._outgoing = incoming, outgoing
        self._sending = threading.Lock()

    def send(self, message: object) -> None:
        """Hand over a message, waiting while the pipe is full. Raises OSError once the other end is gone."""
        data = pickle.dumps(message, 5)  # a whole one before any of it is written
        with self._sending:
            self._outgoing.write(data)
            self._outgoing.flush()

    def receive(self) -> Any:
        """Return the next message. Raises EOFError once the other end is gone."""
        try:
            return pickle.load(self._incoming)
        except (OSError, ValueError, pickle.UnpicklingError):  # torn while it was written
            raise EOFError from None

    def close(self) -> None:
        """Let the other end see that this one is gone."""
        for pipe in (self._outgoing, self._incoming):
            with suppress(OSError):
                pipe.close()
