"""Mask methods by fixed skin colour and by depth, and the table of all methods that session.toml may name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Annotated, Any, ClassVar

import cv2
import numpy as np
from msgspec import Meta

from handtrack.arrays import D3, Array, Bytes, H, W
from handtrack.capture.images.frames import FrameSource
from handtrack.capture.masks.background import BackgroundMedian, BackgroundMog2
from handtrack.capture.masks.mask_cleaning import Roi, clean
from handtrack.capture.masks.seeded import Seeded
from handtrack.capture.masks.skin_adaptive import SkinAdaptive
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import above, at_least, checked_table, read_table, required

Segmenter = Callable[[Array[H, W, D3]], Bytes[H, W]]
"""image BGR → mask {0, 255}"""
_Range = Annotated[tuple[int, int], Meta(description="2 whole numbers [least, most]")]


@dataclass(frozen=True)
class SkinYCrCb:
    """Skin as a box in YCrCb (8 bit, OpenCV's conversion)."""

    name: ClassVar[str] = "skin_ycrcb"
    needs: ClassVar[str] = "images"

    y_min: Annotated[int, at_least(0)] = 40
    """least luminance."""
    cr: _Range = (138, 175)
    """closed range of Cr."""
    cb: _Range = (85, 125)
    """closed range of Cb."""
    open_px: Annotated[int, at_least(0)] = 5
    """side of the square of the opening [px]; 0 for none."""
    largest: bool = True
    """keep only the largest component."""

    def __post_init__(self) -> None:
        for key, (low, high) in (("cr", self.cr), ("cb", self.cb)):
            if not 0 <= low <= high <= 255:
                raise ValueError(
                    f"{key} = [{low}, {high}]; expected least and most within 0 to 255, in this order."
                )

    def segmenter(
        self, source: FrameSource, roi: Roi | None = None, unit_m: float = 1.0
    ) -> Segmenter:
        """Return the function from a BGR image (H, W, 3) uint8 to its mask; nothing is learned
        from the source."""
        low = np.array([self.y_min, self.cr[0], self.cb[0]])
        high = np.array([255, self.cr[1], self.cb[1]])

        def segment(image: Array) -> Bytes:
            skin = cv2.inRange(cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb), low, high)
            return clean(skin, self.open_px, self.largest, roi)  # type: ignore[arg-type]

        return segment


@dataclass(frozen=True)
class DepthRange:
    """Whatever lies within a range of the camera's depth z."""

    name: ClassVar[str] = "depth_range"
    needs: ClassVar[str] = "depth"

    near_m: Annotated[float, above(0, "m")]
    """nearest depth that counts [m]."""
    far_m: Annotated[float, above(0, "m")]
    """farthest depth that counts [m]."""
    open_px: Annotated[int, at_least(0)] = 0
    """side of the square of the opening [px]; 0 for none."""
    largest: bool = False
    """keep only the largest component."""

    def __post_init__(self) -> None:
        if self.far_m <= self.near_m:
            raise ValueError(f"far_m = {self.far_m}; expected a number above {self.near_m:g} [m].")

    def segmenter(
        self, source: FrameSource, roi: Roi | None = None, unit_m: float = 1.0
    ) -> Segmenter:
        """Return the function from a depth image (H, W) uint16, unit_m metres a unit, to its mask;
        0 is no measurement."""

        def segment(depth: Array) -> Bytes:
            metres = depth * unit_m
            near = (depth > 0) & (metres >= self.near_m) & (metres <= self.far_m)
            return clean(np.where(near, 255, 0).astype(np.uint8), self.open_px, self.largest, roi)

        return segment


MaskMethod = SkinYCrCb | SkinAdaptive | BackgroundMedian | BackgroundMog2 | DepthRange | Seeded
METHODS: dict[str, type[MaskMethod]] = {
    kind.name: kind
    for kind in (SkinYCrCb, SkinAdaptive, BackgroundMog2, BackgroundMedian, DepthRange, Seeded)
}


def read_mask_method(table: Any, where: str) -> MaskMethod:
    """Return the mask method of an inline table `{ method = "...", ... }`.

    where: file and table for the errors. Raises HandtrackError naming the known methods or keys.
    """
    name = required(checked_table(table, where), "method", where)
    if name not in tuple(METHODS):
        raise HandtrackError(
            f"{where}: unknown mask method '{name}'; known methods: {', '.join(METHODS)}."
        )
    return read_table(METHODS[name], table, f'{where}, method "{name}"', also=["method"])


def mask_method_table(method: MaskMethod) -> dict[str, Any]:
    """Return the inline table that reads back as the method."""
    return {"method": method.name, **asdict(method)}
