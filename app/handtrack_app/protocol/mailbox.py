"""A queue that keeps only the newest of each kind where only the newest counts."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Item = TypeVar("Item")


class Mailbox(Generic[Item]):
    """Thread-safe queue. Items with an equal `kind` (not None) replace one another: the latest wins."""

    def __init__(self, kind: Callable[[Item], Hashable | None]) -> None:
        self._kind = kind
        self._items: deque[Item] = deque()
        self._ready = threading.Condition()

    def put(self, item: Item) -> None:
        """Add an item at the end, dropping a waiting one that it replaces."""
        kind = self._kind(item)
        with self._ready:
            if kind is not None:
                for old in self._items:
                    if self._kind(old) == kind:
                        self._items.remove(old)
                        break
            self._items.append(item)
            self._ready.notify()

    def take(self, timeout: float | None = None) -> Item | None:
        """Return the oldest item, or None when `timeout` [s] has passed."""
        with self._ready:
            if not self._ready.wait_for(lambda: bool(self._items), timeout):
                return None
            return self._items.popleft()

    def __len__(self) -> int:
        return len(self._items)
