"""Counts what is compiled for this machine, so that the page can tell what the first frame waits for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_EVENT = "numba:compile"  # sent for what is not in numba's cache, and for nothing else
ABOUT = 30  # kernels that tracking silhouettes compiles


class CompileWatch:
    """Number of our own kernels compiled since it was made; always 0 where numba does not tell."""

    def __init__(self, tell: Callable[[str], None] | None = None) -> None:
        """tell: is given the words at each kernel, on the thread that compiles."""
        self.count = 0
        try:
            from numba.core import event
        except ImportError:  # not a promised part of numba
            return
        watch = self

        class Counter(event.Listener):
            def on_start(self, event: Any) -> None:
                function = getattr(event.data.get("dispatcher"), "py_func", None)
                if getattr(function, "__module__", "").startswith("handtrack"):
                    watch.count += 1
                    if tell is not None:
                        tell(watch.words)

            def on_end(self, event: Any) -> None:
                pass

        event.register(_EVENT, Counter())

    @property
    def words(self) -> str:
        """What is going on, in words; empty while nothing was compiled."""
        if not self.count:
            return ""
        return f"Compiling for this machine, only this once: part {self.count} of about {max(ABOUT, self.count)}"
