"""Mask methods by fixed skin colour and by depth, and the table of all methods that session.toml may name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import cv2
import numpy as np

from handtrack.arrays import Array, Bytes
from handtrack.capture.images.frames import FrameSource
from handtrack.capture.masks.background import BackgroundMedian, BackgroundMog2
from handtrack.capture.masks.mask_cleaning import Roi, clean
from handtrack.capture.masks.skin_adaptive import SkinAdaptive
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import TableReader

Segmenter = Callable[[Array], Bytes]
"""image → mask (H, W) uint8 {0, 255}"""


@dataclass(frozen=True)
class SkinYCrCb:
    """Skin as a box in YCrCb (8 bit, OpenCV's conversion)."""

    name: ClassVar[str] = "skin_ycrcb"
    needs: ClassVar[str] = "images"

    y_min: int = 40
    """least luminance."""
    cr: tuple[int, int] = (138, 175)
    """closed range of Cr."""
    cb: tuple[int, int] = (85, 125)
    """closed range of Cb."""
    open_px: int = 5
    """side of the square of the opening [px]; 0 for none."""
    largest: bool = True
    """keep only the largest component."""

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

    @classmethod
    def read(cls, table: TableReader) -> SkinYCrCb:
        """Return the settings of an inline table. Raises HandtrackError."""
        default = cls()
        return cls(
            y_min=table.whole("y_min", default.y_min),
            cr=_range(table, "cr", default.cr),
            cb=_range(table, "cb", default.cb),
            open_px=table.whole("open_px", default.open_px),
            largest=table.flag("largest", default.largest),
        )


@dataclass(frozen=True)
class DepthRange:
    """Whatever lies within a range of the camera's depth z."""

    name: ClassVar[str] = "depth_range"
    needs: ClassVar[str] = "depth"

    near_m: float
    """nearest depth that counts [m]."""
    far_m: float
    """farthest depth that counts [m]."""
    open_px: int = 0
    """side of the square of the opening [px]; 0 for none."""
    largest: bool = False
    """keep only the largest component."""

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

    @classmethod
    def read(cls, table: TableReader) -> DepthRange:
        """Return the settings of an inline table. Raises HandtrackError."""
        near_m = table.number("near_m", above=0.0, unit="m")
        return cls(
            near_m=near_m,
            far_m=table.number("far_m", above=near_m, unit="m"),
            open_px=table.whole("open_px", 0),
            largest=table.flag("largest", False),
        )


MaskMethod = SkinYCrCb | SkinAdaptive | BackgroundMedian | BackgroundMog2 | DepthRange
METHODS: dict[str, type[MaskMethod]] = {
    kind.name: kind
    for kind in (SkinYCrCb, SkinAdaptive, BackgroundMog2, BackgroundMedian, DepthRange)
}


def read_mask_method(table: Any, where: str) -> MaskMethod:
    """Return the mask method of an inline table `{ method = "...", ... }`.

    where: file and table for the errors. Raises HandtrackError naming the known methods or keys.
    """
    reader = TableReader(table, where)
    name = reader.text("method")
    if name not in METHODS:
        raise HandtrackError(
            f"{where}: unknown mask method '{name}'; known methods: {', '.join(METHODS)}."
        )
    reader.where = f'{where}, method "{name}"'
    method = METHODS[name].read(reader)
    reader.finish()
    return method


def mask_method_table(method: MaskMethod) -> dict[str, Any]:
    """Return the inline table that reads back as the method."""
    return {"method": method.name, **asdict(method)}


def _range(table: TableReader, key: str, default: tuple[int, int]) -> tuple[int, int]:
    low, high = table.whole_list(key, default, "least most")
    if not 0 <= low <= high <= 255:
        raise table.error(key, [low, high], "least and most within 0 to 255, in this order")
    return low, high
