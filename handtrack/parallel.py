"""Independent work on all cores: the same results in the same order, whatever the number of threads."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_inside = threading.local()


def thread_count() -> int:
    """Return how many threads work at once: the cores this process may use, or what HANDTRACK_THREADS says."""
    chosen = os.environ.get("HANDTRACK_THREADS", "")
    if chosen.isdecimal() and int(chosen) > 0:
        return int(chosen)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_parallel(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return function(item) of each item, in their order. Compiled loops hold no lock, so threads are enough.

    Called from within itself it runs where it is: the outer items keep all cores busy already.
    """
    items = list(items)
    if len(items) < 2 or thread_count() < 2 or getattr(_inside, "is_worker", False):
        return [function(item) for item in items]
    return list(_pool(thread_count()).map(function, items))


def workers(threads: int, name: str = "handtrack") -> ThreadPoolExecutor:
    """Return a pool in which each piece of work has one thread: `in_parallel` within it runs where it is."""

    def mark() -> None:
        _inside.is_worker = True

    return ThreadPoolExecutor(threads, name, initializer=mark)


@lru_cache(maxsize=1)
def _pool(threads: int) -> ThreadPoolExecutor:
    return workers(threads)
