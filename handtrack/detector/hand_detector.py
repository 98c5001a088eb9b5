"""Hands in one image: where palms are, and the 21 points of the hand in a region."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import D2, D3, D21, Array, Floats, H, W
from handtrack.detector.networks import open_network, usual_backend
from handtrack.detector.palms import PALM_SIZE, palms
from handtrack.detector.regions import Region, region_of_hand, region_of_palm, whole_image
from handtrack.detector.weights import Weights, find_weights, read_weights
from handtrack.errors import HandtrackError

_HAND_SIZE = 224  # of the landmark network's image [px]
_UNEXPECTED = (cv2.error, KeyError, ValueError, IndexError)
"""what networks of another shape lead to"""
_LEAST_PRESENCE = 0.5
_LEAST_SIDE = 8.0  # [px]: a smaller region shows nothing


@dataclass(frozen=True, eq=False)
class DetectedHand:
    """A hand in an image."""

    points: Floats[D21, D2]
    """column, row [px] as OpenCV counts: wrist, thumb CMC MCP IP tip, then of each finger MCP PIP DIP tip"""
    presence: float
    """probability that it is a hand"""
    right: float
    """probability that it is a right hand, in an image that is not mirrored"""

    @property
    def region(self) -> Region:
        """Where to look for it in the next frame."""
        return region_of_hand(self.points)


class HandDetector:
    """The two networks. To be used by one thread at a time."""

    def __init__(self, weights: Weights, backend: str | None = None) -> None:
        """backend: opencv or litert; the quicker one that is there, unless given. Raises HandtrackError."""
        self.backend = backend or usual_backend()
        self.weights = weights
        where = str(weights.path)
        self._palm = open_network(weights.palm, self.backend, where)
        self._landmarks = open_network(weights.landmarks, self.backend, where)

    @classmethod
    def open(cls, weights: Path | None = None, backend: str | None = None) -> HandDetector:
        """Return the detector with given, named or installed weights. Raises HandtrackError where there are none."""
        return cls(read_weights(find_weights(weights)), backend)

    def find(self, image: Array[H, W, D3], most: int) -> list[Region]:
        """Return where up to `most` hands may be, the surest first. image: uint8 BGR."""
        square = whole_image(image.shape[1], image.shape[0])
        try:
            out = self._palm(square.crop(image, PALM_SIZE))
            numbers, logits = out["Identity"].reshape(-1, 18), out["Identity_1"].reshape(-1)
            found = palms(numbers, logits, most)
        except _UNEXPECTED:
            raise self._unexpected("palm") from None
        return [
            region_of_palm(
                np.concatenate([square.to_image(palm.box[:2]), palm.box[2:] * square.side]),
                square.to_image(palm.points),
            )
            for palm in found
        ]

    def hand(self, image: Array[H, W, D3], region: Region) -> DetectedHand | None:
        """Return the hand in a region of an image uint8 BGR, None where there is none."""
        if not (np.isfinite(region.centre).all() and region.side >= _LEAST_SIDE):
            return None
        try:
            out = self._landmarks(region.crop(image, _HAND_SIZE))
            found = out["Identity"].reshape(21, 3)[:, :2].astype(float)
            presence, right = (float(out[f"Identity_{i}"].reshape(())) for i in (1, 2))
        except _UNEXPECTED:
            raise self._unexpected("landmark") from None
        if not (presence >= _LEAST_PRESENCE and np.isfinite(found).all()):
            return None
        return DetectedHand(region.to_image(found / _HAND_SIZE), presence, right)

    def _unexpected(self, network: str) -> HandtrackError:
        return HandtrackError(
            f"{self.weights.path}: the {network} network answers in another form than expected; these are weights of another "
            "detector. Name Google's hand_landmarker.task with --weights."
        )
