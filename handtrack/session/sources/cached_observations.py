"""Observations and masks as they are kept in memory, small enough for a long recording, and how many of them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from handtrack.arrays import D2, Array, Bytes, H, Ints, N, W, array_dataclass
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.geometry.camera import Camera
from handtrack.observation.observation import UNKNOWN, Observation, Silhouette
from handtrack.tracking.frame.constants import FRAMES_AHEAD

LEAST_KEPT = 2 * (FRAMES_AHEAD + 4)
"""observations that are kept however large: those that a search may have solved anew, with a cloud and without"""
_BYTES_KEPT = 400_000_000
"""of all observations: the estimate of all frames reads each about five times"""
_MASK_BYTES_KEPT = 50_000_000
"""of one camera's computed masks, which clouds and the page read beside observations"""
_POINTS_KEPT = 12_000_000
"""of all clouds before filtering, 300 MB: the estimate of all frames reads each about six times"""


@array_dataclass
class CroppedMask:
    """A mask without the background around its hand: a tenth or less of its size."""

    size: tuple[int, int]
    """height, width"""
    corner: tuple[int, int]
    """row, column of the part"""
    part: Array[H, W]
    unknown: Bytes[N] | None
    """a bit for each pixel of the mask, whether it is UNKNOWN; None where none is"""

    @classmethod
    def of(cls, mask: Array[H, W]) -> CroppedMask:
        """Cut a mask to the smallest rectangle with all that is above 0."""
        x, y, width, height = cv2.boundingRect((mask > 0).view(np.uint8))
        unknown = mask < 0
        bits = np.packbits(unknown) if unknown.any() else None
        return cls(mask.shape, (y, x), mask[y : y + height, x : x + width].copy(), bits)

    @property
    def whole(self) -> Array[H, W]:
        """The mask, in memory of its own."""
        mask, (y, x) = np.zeros(self.size, self.part.dtype), self.corner
        mask[y : y + self.part.shape[0], x : x + self.part.shape[1]] = self.part
        if self.unknown is not None:
            bits = np.unpackbits(self.unknown, count=mask.size).view(bool)
            mask[bits.reshape(self.size)] = UNKNOWN
        return mask

    @property
    def nbytes(self) -> int:
        """How much memory it takes."""
        return self.part.nbytes + (0 if self.unknown is None else self.unknown.nbytes)


def most_masks(mask: CroppedMask | None) -> int:
    """Return how many masks like one are kept."""
    return _MASK_BYTES_KEPT // max(mask.nbytes if mask else 0, 1000)


def most_clouds(cloud: PointCloud | None) -> int:
    """Return how many clouds like one are kept."""
    size = 1 if cloud is None else max(len(cloud), 1)
    return max(_POINTS_KEPT // size, 1)


Kept = tuple[Observation, list[tuple[Camera, CroppedMask, Ints[H, D2], float]]]
"""an observation but its silhouettes, and of each of these camera, mask, `valid` and `off_px`"""


def kept(seen: Observation) -> Kept:
    """Return an observation with masks cut to their hands: undistorting and weighing them takes longer than reading them did."""
    cut = [(s.camera, CroppedMask.of(s.mask), s.valid, s.off_px) for s in seen.silhouettes]
    return replace(seen, silhouettes=()), cut


def whole(seen: Kept) -> Observation:
    """Return an observation that was kept, its masks in memory of their own."""
    others, cut = seen
    silhouettes = (
        Silhouette(camera, mask.whole, valid, off_px) for camera, mask, valid, off_px in cut
    )
    return replace(others, silhouettes=tuple(silhouettes))


def most_observations(seen: Kept) -> int:
    """Return how many observations like one are kept."""
    others, cut = seen
    cloud = 0 if others.cloud is None else others.cloud.points.nbytes
    size = cloud + sum(mask.nbytes for _, mask, *_ in cut)
    return max(_BYTES_KEPT // max(size, 1000), LEAST_KEPT)
