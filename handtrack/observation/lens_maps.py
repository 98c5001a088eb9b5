"""What brings a camera's real image into the undistorted one: computed once for a camera and a region of interest."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from handtrack.arrays import D2, Array, Axes, Floats, H, Ints, W, pixel_grid
from handtrack.geometry.camera import Camera
from handtrack.geometry.lens import remap_source

Roi = tuple[int, int, int, int]
"""x, y, width, height [px] in the real, distorted image."""
_BAND = 100_000
"""numbers of as many rows as are bent at a time: what comes in between stays in the processor's cache, and small"""


class LensMaps(NamedTuple):
    """Where each undistorted pixel comes from."""

    camera: Camera
    """without distortion"""
    source: Floats[H, W, D2] | None
    """float32: the place in the real image of each undistorted pixel; None without distortion."""
    valid: Ints[H, D2]
    """int32: per row the largest run of pixels that come from inside the image and the region of interest"""

    def straightened(self, pixels: Array[H, W, *Axes]) -> Array[H, W, *Axes]:
        """Return an image (H, W, …) without distortion, bilinearly interpolated; itself where the lens has none."""
        if self.source is None:
            return pixels
        border = cv2.BORDER_REPLICATE
        return cv2.remap(pixels, self.source, None, cv2.INTER_LINEAR, borderMode=border)  # type: ignore[call-overload]


@lru_cache(maxsize=32)
def lens_maps(camera: Camera, roi: Roi | None) -> LensMaps:
    """Return a camera's maps. The camera without distortion is the same object each time, so that it can be a key."""
    straight = camera.without_distortion() if camera.is_distorted else camera
    pixels = pixel_grid(camera.size)
    bands = np.array_split(pixels, -(-pixels.size // _BAND))
    source, valid = zip(*(_of_rows(camera, roi, rows) for rows in bands), strict=True)
    runs = np.concatenate(valid)
    runs.flags.writeable = False
    return LensMaps(straight, np.concatenate(source) if camera.is_distorted else None, runs)


def _of_rows(camera: Camera, roi: Roi | None, pixels: Floats[H, W, D2]) -> tuple[Array, Array]:
    """Return where the undistorted pixels of some rows come from, and the rows' runs of valid ones."""
    width, height = camera.size
    source = camera.distort_points(pixels) if camera.is_distorted else pixels
    inside = _inside(source, (0, 0, width, height)) & _inside(source, roi or (0, 0, width, height))
    # beyond the lens's field the source is NaN; any place will do, since those pixels are not valid
    return remap_source(source), longest_runs(inside)


def _inside(source: Array, box: Roi) -> Array:
    """Return where source points (H, W, 2) lie in a box of whole pixels (a pixel reaches half a
    unit each way)."""
    x, y, width, height = box
    low, high = np.array([x, y]) - 0.5, np.array([x + width, y + height]) - 0.5
    return np.asarray(((source >= low) & (source < high)).all(axis=-1))


def longest_runs(inside: Array[H, W]) -> Ints[H, D2]:
    """Return per row of booleans the longest run of true, half-open, as int32; the first of equals."""
    height, width = inside.shape
    position = np.arange(1, width + 1)
    last_outside = np.maximum.accumulate(np.where(inside, 0, position), axis=1)
    length = np.where(inside, position - last_outside, 0)
    end = np.argmax(length, axis=1) + 1
    longest = length[np.arange(height), end - 1]
    runs = np.stack([end - longest, end], axis=1)
    runs[longest == 0] = 0
    return runs.astype(np.int32)  # type: ignore[return-value]
