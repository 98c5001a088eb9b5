"""Progress with ETA on stderr, and a Ctrl-C that stops cleanly."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm


def progress_bar(total: int, what: str) -> tqdm:
    """Return a bar on stderr; one line every few seconds where stderr is no terminal."""
    interval = 0.2 if sys.stderr.isatty() else 5.0
    return tqdm(total=total, desc=what, unit="frame", mininterval=interval, dynamic_ncols=True)


@contextmanager
def stoppable() -> Iterator[Callable[[], bool]]:
    """Give a function that turns true at the first Ctrl-C; the second one interrupts at once."""
    stopped = False

    def stop(*_: object) -> None:
        nonlocal stopped
        if stopped:
            raise KeyboardInterrupt
        stopped = True

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield lambda: stopped
    finally:
        signal.signal(signal.SIGINT, before)
