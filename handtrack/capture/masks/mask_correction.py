"""What mends a mask: its cleaning, with which every method ends, and a person's correction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta

from handtrack.arrays import D2, D3, Bytes, Floats, H, N, W, pixel_grid
from handtrack.files.toml_table import at_least

# ---- Region of interest, opening, largest component


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


# ---- A layer over a mask, painted stroke by stroke, and carried on to frames beside


UNKNOWN_LEVEL = 128
"""in masks of 8 bits: hand or background, nobody can tell"""
AS_IT_IS = 64
"""in a layer: not corrected, the mask stays as its method or file has it"""
HAND, BACKGROUND = 255, 0
LEVELS = (BACKGROUND, AS_IT_IS, UNKNOWN_LEVEL, HAND)

_FLOW_PX = 640
"""images are looked at this large for the flow: bounds its cost; a finger is still 10 pixels wide"""
_ASTRAY_PX = 1.5
"""flow that does not lead back to where it came from, by more than this and a share of its length, is not believed (Sundaram,
Brox & Keutzer 2010: 0.5 and 1 % of both squared; DIS at half size is coarser)"""
_ASTRAY_SHARE = 0.1
_CHANGED = 40
"""8 bit levels by which the grey of what is followed may change from frame to frame: skin before a desk differs by more"""


def empty_layer(size: tuple[int, int]) -> Bytes[H, W]:
    """Return a layer for images of (width, height) that corrects nothing."""
    return np.full((size[1], size[0]), AS_IT_IS, np.uint8)


def painted(layer: Bytes[H, W], points: Floats[N, D2], radius_px: float, level: int) -> Bytes[H, W]:
    """Return a layer with a stroke of a round brush through points, columns and rows [px] of the image as it was taken."""
    drawn = np.zeros_like(layer)
    half = max(float(radius_px), 0.5)
    places = [(round(16 * float(x)), round(16 * float(y))) for x, y in points]
    for place in places:
        cv2.circle(drawn, place, round(16 * half), 1, -1, cv2.LINE_8, 4)
    if len(places) > 1:
        line = np.array(places, np.int32)[:, None]
        cv2.polylines(drawn, [line], False, 1, max(round(2 * half), 1), cv2.LINE_8, 4)
    return np.where(drawn > 0, np.uint8(level), layer).astype(np.uint8)


def corrected(layer: Bytes[H, W], mask: Bytes[H, W] | None, unknown: int) -> Bytes[H, W]:
    """Return a mask corrected by a layer; without a mask nobody knows anything else. unknown: the result's value for that."""
    result = np.full_like(layer, unknown) if mask is None else mask.copy()
    for level, value in ((HAND, 255), (BACKGROUND, 0), (UNKNOWN_LEVEL, unknown)):
        result[layer == level] = value
    return result


def carried(layer: Bytes[H, W], image: Bytes[H, W, D3], other: Bytes[H, W, D3]) -> Bytes[H, W]:
    """Return the layer of an image BGR moved to the next or previous one by optical flow.

    Where the flow there and back do not agree, or what it leads to looks different, what was corrected is unknown.
    """
    height, width = layer.shape
    scale = min(1.0, _FLOW_PX / max(height, width))
    size = max(round(scale * width), 16), max(round(scale * height), 16)
    here, there = (
        cv2.resize(cv2.cvtColor(i, cv2.COLOR_BGR2GRAY), size, interpolation=cv2.INTER_AREA)
        for i in (image, other)
    )
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    back = flow.calc(there, here, None)  # type: ignore[call-overload]
    forth = flow.calc(here, there, None)  # type: ignore[call-overload]
    at = pixel_grid(size).astype(np.float32) + back
    led, found = (
        cv2.remap(picture, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        for picture in (forth, here)
    )
    changed = cv2.blur(cv2.absdiff(found, there), (3, 3)) > _CHANGED
    away = np.linalg.norm(back + led, axis=-1)
    length = np.linalg.norm(back, axis=-1) + np.linalg.norm(led, axis=-1)
    astray = away > _ASTRAY_PX + _ASTRAY_SHARE * length
    outside = (at < -0.5).any(axis=-1) | (at > np.array(size) - 0.5).any(axis=-1)
    lost = (astray | changed | outside).astype(np.uint8)
    lost = cv2.resize(lost, (width, height), interpolation=cv2.INTER_NEAREST) > 0
    step = cv2.resize(back, (width, height), interpolation=cv2.INTER_LINEAR)
    step = step * np.array([width / size[0], height / size[1]], np.float32)
    source = pixel_grid((width, height)).astype(np.float32) + step
    border = {"borderMode": cv2.BORDER_CONSTANT, "borderValue": AS_IT_IS}
    moved = cv2.remap(layer, source, None, cv2.INTER_NEAREST, **border)  # type: ignore[call-overload]
    return np.where(lost & (moved != AS_IT_IS), UNKNOWN_LEVEL, moved).astype(np.uint8)
