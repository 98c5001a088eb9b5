"""Independent work on all cores: the same results in the same order, whatever the number of threads; and what threads share."""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ContextDecorator
from functools import lru_cache
from typing import Any, Generic, TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")
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


if hasattr(os, "register_at_fork"):
    # a copy of this process has none of the pool's threads, and would wait for them for ever
    os.register_at_fork(after_in_child=_pool.cache_clear)


class _OneBlasThread(ContextDecorator):
    def __init__(self) -> None:
        self._inside = 0
        self._limit: Any = None
        self._unlock()
        if hasattr(os, "register_at_fork"):
            # a copy of this process has only the thread that forked, not the one that held the lock
            os.register_at_fork(after_in_child=self._unlock)

    def _unlock(self) -> None:
        self._lock = threading.Lock()

    def __enter__(self) -> None:
        with self._lock:
            if self._inside == 0:
                self._limit = _controlled_blas().limit(limits=1, user_api="blas")
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside == 0:
                _controlled_blas()
                self._limit.restore_original_limits()


one_blas_thread = _OneBlasThread()
"""While it lasts, or a function runs that it decorates, linear algebra of NumPy takes one thread in this process: more only wait for
each other, and change the order of sums. Compiled code takes SciPy's, for matrices too small to be shared between threads."""


def _controlled_blas() -> Any:
    """Return what sets how many threads BLAS takes, from this thread: in threadpoolctl 3.8 the first one that ever did holds that
    alone."""
    controller = _blas()
    for library in controller.lib_controllers:
        if hasattr(library, "clear_controlling_thread"):
            library.clear_controlling_thread(force=True)
    return controller


@lru_cache(maxsize=1)
def _blas() -> Any:
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


class LRUCache(Generic[Key, Value]):
    """Values by keys; those longest not used are forgotten. Safe from several threads."""

    def __init__(self) -> None:
        self._values: OrderedDict[Key, Value] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: Key) -> Value | None:
        """Return the value of a key; None where there is none."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
            return self._values.get(key)

    def put(self, key: Key, value: Value, most: int) -> None:
        """Keep a value, and with it at most so many in all."""
        with self._lock:
            self._values[key] = value
            self._values.move_to_end(key)
            while len(self._values) > most:
                self._values.popitem(last=False)

    def value(self, key: Key, make: Callable[[], Value], most: Callable[[Value], int]) -> Value:
        """Return the value of a key, made unless it is kept. most: how many like it may be kept."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key]
        value = make()
        self.put(key, value, most(value))
        return value

    def clear(self) -> None:
        """Forget everything."""
        with self._lock:
            self._values.clear()
