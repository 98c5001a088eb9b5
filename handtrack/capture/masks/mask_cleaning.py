"""Last steps of every mask method: region of interest, opening, largest component."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta

from handtrack.arrays import Bytes, H, W
from handtrack.files.toml_table import at_least

Roi = Annotated[tuple[int, int, int, int], Meta(description="4 whole numbers [x, y, w, h]")]
"""x, y, width, height [px]"""


@dataclass(frozen=True, kw_only=True)
class Cleaning:
    """What every mask method that decides pixel by pixel ends with."""

    open_px: Annotated[int, at_least(0)] = 5
    """side of the square of the opening [px]; 0 for none."""
    largest: bool = True
    """keep only the largest component."""

    def cleaned(self, mask: Bytes[H, W], roi: Roi | None) -> Bytes[H, W]:
        """Return the mask uint8 {0, 255} inside the region of interest, opened, largest piece only."""
        if roi is not None:
            mask = inside_roi(mask, roi)
        if self.open_px > 1:
            mask = opened(mask, self.open_px)
        return largest_component(mask) if self.largest else mask


def inside_roi(mask: Bytes[H, W], roi: Roi) -> Bytes[H, W]:
    """Return the mask with everything outside roi = (x, y, width, height) [px] cleared."""
    x, y, width, height = roi
    kept = np.zeros_like(mask)
    kept[y : y + height, x : x + width] = mask[y : y + height, x : x + width]
    return kept


def opened(mask: Bytes[H, W], side_px: int) -> Bytes[H, W]:
    """Return the opening with a square of side_px; an even one too shifts nothing."""
    square = np.ones((side_px, side_px), np.uint8)
    at = side_px // 2
    back = side_px - 1 - at  # the dilation needs the square reflected
    shrunk = cv2.erode(mask, square, anchor=(at, at))
    return cv2.dilate(shrunk, square, anchor=(back, back))  # type: ignore[return-value]


def largest_component(mask: Bytes[H, W]) -> Bytes[H, W]:
    """Return the largest 8-connected piece of a mask; of equals the first in reading order."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if len(stats) < 2:
        return mask
    chosen = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    return np.where(labels == chosen, 255, 0).astype(np.uint8)
