"""Counts what is compiled for this machine, so that the user can be told what the first frame waits for."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

_EVENT = "numba:compile"  # sent for what is not in numba's cache, and for nothing else
ABOUT = 61  # kernels that tracking silhouettes compiles, as counted in a fresh clone


class CompileWatch:
    """Number of our own kernels compiled since it was made; always 0 where numba does not tell."""

    def __init__(self, on_kernel: Callable[[str], None]) -> None:
        """on_kernel: is given the words at each kernel, on the thread that compiles."""
        self.count, counting = 0, ExitStack()
        self.close = counting.close
        """end the counting"""
        try:
            from numba.core import event as events
        except ImportError:  # not a promised part of numba
            return
        watch = self

        class Counter(events.Listener):
            def on_start(self, event: events.Event) -> None:
                function = getattr((event.data or {}).get("dispatcher"), "py_func", None)
                if getattr(function, "__module__", "").startswith("handtrack"):
                    watch.count += 1
                    on_kernel(watch.words)

            def on_end(self, event: events.Event) -> None:
                pass

        counting.enter_context(events.install_listener(_EVENT, Counter()))

    @property
    def words(self) -> str:
        """What is going on, in words."""
        return f"Compiling for this machine, only this once: part {self.count} of about {max(ABOUT, self.count)}"
