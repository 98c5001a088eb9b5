"""A smoothed window of an image, in which terms look up brightness and its slope."""

from __future__ import annotations

import cv2
import numpy as np

from handtrack.arrays import D2, D3, Array, Floats, H, N, W, array_dataclass
from handtrack.terms.images.image_kernels import look_up_all

_REACH = 3.0  # sigmas that a pixel spreads


@array_dataclass
class SmoothImage:
    """Part of an undistorted image after a Gaussian. Beyond the image the border's value goes on."""

    corner: tuple[int, int]
    """column and row of the window's first pixel in the image"""
    values: Array[H, W, D3]
    """float32, 0 … 255"""

    def look_up(self, pixels: Floats[N, D2]) -> tuple[Floats[N, D3], Floats[N, D3, D2]]:
        """Return values and their slopes [1/px] at image points, bilinear."""
        count, channels = len(pixels), self.values.shape[2]
        values, slopes = np.empty((count, channels)), np.empty((count, channels, 2))
        at = np.ascontiguousarray(pixels - np.array(self.corner, dtype=float))
        look_up_all(self.values, at, values, slopes)
        return values, slopes


def smooth_image(
    pixels: Array[H, W, D3], sigma_px: float, around: Floats[N, D2], margin_px: float = 0.0
) -> SmoothImage:
    """Return the smoothed part of an image uint8 that holds the points `around`, with a margin."""
    height, width = pixels.shape[:2]
    size = np.array([width, height])
    seen = around[np.isfinite(around).all(axis=1)]
    low, high = np.zeros(2), np.array([2.0, 2.0])
    if len(seen):
        low, high = seen.min(axis=0) - margin_px, seen.max(axis=0) + margin_px
    first = np.clip(np.floor(low), 0, size - 2).astype(np.int64)
    last = np.clip(np.ceil(high) + 1, first + 2, size).astype(np.int64)
    spread = int(np.ceil(_REACH * sigma_px)) + 1
    from_, to = np.maximum(first - spread, 0), np.minimum(last + spread, size)
    part = np.ascontiguousarray(pixels[from_[1] : to[1], from_[0] : to[0]], dtype=np.float32)
    if sigma_px > 0:
        part = cv2.GaussianBlur(part, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)
    x, y = first - from_
    w, h = last - first
    values = np.ascontiguousarray(part[y : y + h, x : x + w])
    return SmoothImage((int(first[0]), int(first[1])), values)
