"""How much of what was read of a session is cached, and masks small enough for it."""

from __future__ import annotations

import cv2
import numpy as np

from handtrack.arrays import Bytes, H, W, array_dataclass
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.observation.observation import Observation
from handtrack.tracking.frame.constants import FRAMES_AHEAD

_FRAMES_KEPT = FRAMES_AHEAD + 4  # those that a search may have solved anew are at hand
_OBSERVATIONS_KEPT = 2 * _FRAMES_KEPT  # with a cloud, and without
_PIXELS_KEPT = 400_000_000  # of all masks kept
_MASK_BYTES_KEPT = 200_000_000  # of one camera's computed masks: the estimate of all frames reads each about five times
_POINTS_KEPT = 12_000_000  # of all clouds before filtering, 300 MB: the estimate of all frames reads each about six times


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
