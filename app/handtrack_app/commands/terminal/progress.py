"""Progress with ETA on stderr, what is compiled, and a Ctrl-C that stops cleanly."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager, suppress

from tqdm import tqdm

from handtrack_app.engine.compile_watch import CompileWatch

_SIGNALS = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, n)]


def _interval_s() -> float:
    """Return how often a bar is drawn anew: a line every few seconds where stderr is no terminal."""
    return 0.2 if sys.stderr.isatty() else 5.0


def progress_bar(total: int, what: str) -> tqdm:
    """Return a bar of frames on stderr."""
    return tqdm(total=total, desc=what, unit="frame", mininterval=_interval_s(), dynamic_ncols=True)


@contextmanager
def share_bar(what: str) -> Iterator[Callable[[float, str], None]]:
    """Give what tells how far something without frames is: a share from 0 to 1, and words; the bar comes with the first."""
    bars: list[tqdm] = []

    def tell(share: float, words: str) -> None:
        if not bars:
            shape = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}<{remaining}{postfix}"
            bars.append(
                tqdm(total=1.0, desc=what, mininterval=_interval_s(), bar_format=shape, dynamic_ncols=True)
            )  # fmt: skip
        bars[0].set_postfix_str(words, refresh=False)
        bars[0].update(share - bars[0].n)

    try:
        yield tell
    finally:
        for bar in bars:
            bar.close()


def say(text: str) -> None:
    """Print a line about what goes on, on stderr."""
    print(text, file=sys.stderr, flush=True)


class Stop:
    """Whether the user or the system wants this program to stop; called, it answers. Set by `stoppable`."""

    def __init__(self) -> None:
        self.asked = False
        self.shielded = False
        """while true, no Ctrl-C breaks in: results are being saved"""

    def __call__(self) -> bool:
        return self.asked

    def interrupt(self, *_: object) -> None:
        """Handle one Ctrl-C, or a signal that stands for it."""
        if self.asked and not self.shielded:
            raise KeyboardInterrupt
        if not self.asked:
            with suppress(OSError):  # the terminal may have been closed
                # print is not safe in a handler
                os.write(2, b"\nstopping ... (Ctrl-C again: at once)\n")
        self.asked = True


@contextmanager
def stoppable() -> Iterator[Stop]:
    """Give a Stop that turns true at the first Ctrl-C; the second one raises KeyboardInterrupt at once.

    So do SIGTERM (`timeout`, a cluster's scheduler, a container that is stopped) and SIGHUP (a terminal that is closed).
    """
    stop = Stop()
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN or number == signal.SIGINT:  # `nohup` ignores SIGHUP
            signal.signal(number, stop.interrupt)
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def saying_compiling() -> AbstractContextManager[object]:
    """Within the block, say once that kernels are compiled, if any are: that takes a while, the first time."""
    words = "compiling kernels for this machine; only the first time, about half a minute …"
    watch = CompileWatch(lambda _: say(words) if watch.count == 1 else None)
    return closing(watch)
