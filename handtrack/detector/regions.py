"""A turned square of an image, and where the hand's square is: from a palm's box, or from the hand's points."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from handtrack.arrays import D2, D3, D4, D7, D21, Array, Axes, Floats, H, W

# Numbers and points of both squares are MediaPipe's: the networks were trained on crops made so.
_PALM_SIDE, _PALM_SHIFT = (
    2.6,
    0.5,
)  # times the box's longer side; of its height, towards the fingers
_HAND_SIDE, _HAND_SHIFT = 2.0, 0.1
_PALM_WRIST, _PALM_MIDDLE = 0, 2
_WRIST = 0
_STEADY = (0, 1, 2, 3, 5, 6, 9, 10, 13, 14, 17, 18)  # without the ends of fingers, which move most
_INDEX, _MIDDLE, _RING = 6, 10, 14  # PIP


@dataclass(frozen=True, eq=False)
class Region:
    """A square of an image."""

    centre: Floats[D2]
    """column, row [px], pixel centres at whole numbers"""
    side: float
    """[px]"""
    turn: float
    """[rad]: turns the crop's axes into the image's"""

    def to_image(self, unit: Floats[*Axes, D2]) -> Floats[*Axes, D2]:
        """Return pixels of points of the square, which are 0 to 1 between its edges."""
        return (np.asarray(unit, float) - 0.5) * self.side @ _turning(self.turn).T + self.centre

    def crop(self, image: Array[H, W, D3], size: int) -> Floats[H, W, D3]:
        """Return the square as an image of size × size, RGB float32 from 0 to 1, black outside. image: uint8 BGR."""
        pixels = (np.array([[0, 0], [1, 0], [0, 1]]) + 0.5) / size
        origin, across, down = self.to_image(pixels)
        to_source = np.column_stack([across - origin, down - origin, origin])
        crop = cv2.warpAffine(
            image, to_source, (size, size), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )
        return cv2.cvtColor(crop, cv2.COLOR_BGR2RGB).astype(np.float32) / np.float32(255.0)


def whole_image(width: int, height: int) -> Region:
    """Return the smallest square that holds an image, in its middle."""
    return Region(np.array([width - 1.0, height - 1.0]) / 2, float(max(width, height)), 0.0)


def region_of_palm(box: Floats[D4], points: Floats[D7, D2]) -> Region:
    """Return the hand's square from a palm's box (centre and size) and its seven points [px]."""
    turn = _turn_up(points[_PALM_MIDDLE] - points[_PALM_WRIST])
    up = _turning(turn) @ np.array([0.0, -_PALM_SHIFT * box[3]])
    return Region(box[:2] + up, _PALM_SIDE * float(box[2:].max()), turn)


def region_of_hand(points: Floats[D21, D2]) -> Region:
    """Return the hand's square from its 21 points [px]."""
    knuckles = ((points[_INDEX] + points[_RING]) / 2 + points[_MIDDLE]) / 2
    turn = _turn_up(knuckles - points[_WRIST])
    turning = _turning(turn)
    turned = points[list(_STEADY)] @ turning
    least, most = turned.min(axis=0), turned.max(axis=0)
    size = most - least
    centre = (least + most) / 2 - np.array([0.0, _HAND_SHIFT * size[1]])
    return Region(turning @ centre, _HAND_SIDE * float(size.max()), turn)


def _turn_up(direction: Floats[D2]) -> float:
    """Return the turn with which a direction in the image points up in the crop."""
    return float(np.pi / 2 - np.arctan2(-direction[1], direction[0]))


def _turning(turn: float) -> Floats[D2, D2]:
    cos, sin = np.cos(turn), np.sin(turn)
    return np.array([[cos, -sin], [sin, cos]])
