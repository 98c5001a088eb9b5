"""A detector that sees what a test says, where it says so."""

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import D3, Array, H, W
from handtrack.detector.hand_detector import DetectedHand, Region, region_of_hand
from tests.session.small_session import keypoints

_REACH = 0.6  # of a region's side: how far from its centre a hand may be and still be in it


def hand_at(x: float, y: float) -> DetectedHand:
    """Return an open hand around a pixel."""
    return DetectedHand(keypoints()[:, :2] * 40.0 / 0.15 + (x, y), 0.9, 0.99)


class FakeDetector:
    """Sees hands that a test puts in, image by image; counts how often all of the image was searched."""

    backend = "fake"

    def __init__(self) -> None:
        self.hands: Sequence[DetectedHand] = ()
        self.searches = 0

    def seen(self, _image: Array[H, W, D3]) -> Sequence[DetectedHand]:
        return self.hands

    def find(self, image: Array[H, W, D3], most: int, closely: bool = False) -> list[Region]:
        self.searches += 1
        return [region_of_hand(hand.points) for hand in self.seen(image)][:most]

    def hand(self, image: Array[H, W, D3], region: Region) -> DetectedHand | None:
        def away(hand: DetectedHand) -> float:
            return float(np.linalg.norm(hand.region.centre - region.centre))

        near = [hand for hand in self.seen(image) if away(hand) < _REACH * region.side]
        return min(near, key=away, default=None)


def columns(hands: dict[int, DetectedHand]) -> dict[int, int]:
    """Return the wrist's column of each hand, rounded."""
    return {number: round(float(hand.points[0, 0])) for number, hand in hands.items()}
