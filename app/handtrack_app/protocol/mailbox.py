"""A queue that keeps only the newest of each kind where only the newest counts."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Item = TypeVar("Item")


class Mailbox(Generic[Item]):
    """Thread-safe queue. Items with an equal `kind` (not None) replace one another: the latest wins."""

    def __init__(
        self,
        kind: Callable[[Item], Hashable | None],
        is_step: Callable[[Item], bool] = lambda _: False,
    ) -> None:
        """is_step: whether an item stays between what came before and after it: nothing from before it is replaced."""
        self._kind, self._is_step = kind, is_step
        self._items: deque[Item] = deque()
        self._ready = threading.Condition()

    def put(self, item: Item) -> None:
        """Add an item at the end, dropping a waiting one that it replaces."""
        kind = self._kind(item)
        with self._ready:
            if kind is not None:
                for place in range(len(self._items) - 1, -1, -1):
                    old = self._items[place]
                    if self._kind(old) == kind:
                        del self._items[place]
                        break
                    if self._is_step(old):
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
