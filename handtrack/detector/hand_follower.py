"""The hands of one view from frame to frame: each is looked for where it was, and anew where none is left."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, Array, H, W
from handtrack.detector.hand_detector import DetectedHand, HandDetector

_LOOK_EVERY = 10  # images between looks for hands that are not followed: a tenth more work
_MOST = 2  # hands of one person
_SAME = 0.15  # of the region's side: hands whose points are nearer in the median are one


class HandFollower:
    """Follows up to two hands in the images of one view; each has a number for as long as it is followed."""

    def __init__(self, detector: HandDetector) -> None:
        self._detector = detector
        self._hands: dict[int, DetectedHand] = {}
        self._next_number = 0
        self._since_look = 0

    def step(self, image: Array[H, W, D3] | None) -> dict[int, DetectedHand]:
        """Return the hands in the next image uint8 BGR, by their numbers; none in a missing one, after which they are
        looked for where they were.
        """
        if image is None:
            return {}
        before, self._hands = self._hands, {}
        for number, last in before.items():
            self._take(number, self._detector.hand(image, last.region))
        self._since_look += 1
        if not self._hands or (self._since_look >= _LOOK_EVERY and len(self._hands) < _MOST):
            self._look(image)
        return dict(self._hands)

    def _look(self, image: Array[H, W, D3]) -> None:
        self._since_look = 0
        for region in self._detector.find(image, _MOST):
            if len(self._hands) < _MOST and self._take(
                self._next_number, self._detector.hand(image, region)
            ):
                self._next_number += 1

    def _take(self, number: int, hand: DetectedHand | None) -> bool:
        """Keep a hand, unless it is one that is followed already."""
        if hand is None or any(_same(hand, other) for other in self._hands.values()):
            return False
        self._hands[number] = hand
        return True


def _same(hand: DetectedHand, other: DetectedHand) -> bool:
    apart = np.linalg.norm(hand.points - other.points, axis=1)
    return float(np.median(apart)) < _SAME * other.region.side
