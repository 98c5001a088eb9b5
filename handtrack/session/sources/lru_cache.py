"""What was read of a session, kept for a while. Safe from several threads."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.observation.observation import Observation
from handtrack.tracking.frame.constants import FRAMES_AHEAD

K = TypeVar("K")
V = TypeVar("V")
_FRAMES_KEPT = FRAMES_AHEAD + 4  # those that a search may have solved anew are at hand
_OBSERVATIONS_KEPT = 2 * _FRAMES_KEPT  # with a cloud, and without
_CLOUDS_KEPT = _FRAMES_KEPT  # before filtering
_PIXELS_KEPT = 400_000_000  # of all masks kept
_POINTS_KEPT = 3_000_000  # of all clouds kept: some have a million


class LRUCache(Generic[K, V]):
    """Values by keys; those longest not used are forgotten."""

    def __init__(self) -> None:
        self._kept: OrderedDict[K, V] = OrderedDict()
        self._lock = threading.Lock()

    def value(self, key: K, make: Callable[[], V], most: Callable[[V], int]) -> V:
        """Return the value of a key, made unless it is kept. most: how many like it may be kept."""
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        value = make()
        size = most(value)
        with self._lock:
            self._kept[key] = value
            self._kept.move_to_end(key)
            while len(self._kept) > size:
                self._kept.popitem(last=False)
        return value

    def clear(self) -> None:
        """Forget everything."""
        with self._lock:
            self._kept.clear()


def most_clouds(cloud: PointCloud | None) -> int:
    """Return how many clouds like one are kept."""
    size = 1 if cloud is None else max(len(cloud), 1)
    return min(max(_POINTS_KEPT // size, 1), _CLOUDS_KEPT)


def most_observations(seen: Observation) -> int:
    """Return how many observations like one are kept."""
    pixels = sum(silhouette.mask.size for silhouette in seen.silhouettes)
    return min(_PIXELS_KEPT // max(pixels, 1) + 2, _OBSERVATIONS_KEPT)
