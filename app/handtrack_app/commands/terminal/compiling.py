"""One line when kernels are compiled: that takes a while, the first time on a machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from handtrack_app.commands.terminal.progress import say

_EVENT = "numba:compile"  # sent for what is not in numba's cache, and for nothing else


@contextmanager
def compiling_told() -> Iterator[None]:
    """Within the block, say once that kernels are compiled, if any are."""
    try:
        from numba.core import event
    except ImportError:  # not a promised part of numba: without it nothing is said
        yield
        return

    class Teller(event.Listener):
        told = False

        def on_start(self, event: Any) -> None:
            if not self.told:
                self.told = True
                say(
                    "compiling kernels for this machine; only the first time, about half a minute …"
                )

        def on_end(self, event: Any) -> None:
            pass

    teller = Teller()
    event.register(_EVENT, teller)
    try:
        yield
    finally:
        with suppress(KeyError, ValueError):
            event.unregister(_EVENT, teller)
