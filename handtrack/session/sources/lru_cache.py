"""What was read of a session, kept for a while. Safe from several threads."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

import cv2
import numpy as np

from handtrack.arrays import Bytes, H, W, array_dataclass
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.observation.observation import Observation
from handtrack.tracking.frame.constants import FRAMES_AHEAD

K = TypeVar("K")
V = TypeVar("V")
_FRAMES_KEPT = FRAMES_AHEAD + 4  # those that a search may have solved anew are at hand
_OBSERVATIONS_KEPT = 2 * _FRAMES_KEPT  # with a cloud, and without
_PIXELS_KEPT = 400_000_000  # of all masks kept
_MASK_BYTES_KEPT = 200_000_000  # of one camera's computed masks: the estimate of all frames reads each about five times
_POINTS_KEPT = 12_000_000  # of all clouds before filtering, 300 MB: the estimate of all frames reads each about six times


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


@array_dataclass
class CroppedMask:
    """A mask without the background around its hand: a tenth or less of its size."""

    size: tuple[int, int]
    """height, width"""
    corner: tuple[int, int]
    """row, column of the part"""
    part: Bytes[H, W]

    @classmethod
    def of(cls, mask: Bytes[H, W]) -> CroppedMask:
        """Cut a mask uint8 to the smallest rectangle with all that is not 0."""
        x, y, width, height = cv2.boundingRect(mask)
        return cls(mask.shape, (y, x), mask[y : y + height, x : x + width].copy())

    @property
    def whole(self) -> Bytes[H, W]:
        """The mask, in memory of its own."""
        mask, (y, x) = np.zeros(self.size, np.uint8), self.corner
        mask[y : y + self.part.shape[0], x : x + self.part.shape[1]] = self.part
        return mask


def most_masks(mask: CroppedMask | None) -> int:
    """Return how many masks like one are kept."""
    return _MASK_BYTES_KEPT // max(mask.part.size if mask else 0, 1000)


def most_clouds(cloud: PointCloud | None) -> int:
    """Return how many clouds like one are kept."""
    size = 1 if cloud is None else max(len(cloud), 1)
    return max(_POINTS_KEPT // size, 1)


def most_observations(seen: Observation) -> int:
    """Return how many observations like one are kept."""
    pixels = sum(silhouette.mask.size for silhouette in seen.silhouettes)
    return min(_PIXELS_KEPT // max(pixels, 1) + 2, _OBSERVATIONS_KEPT)
