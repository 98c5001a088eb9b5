"""Mask methods that learn the background from the recording's own frames: median and MOG2."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Bytes, H, W
from handtrack.capture.images.frames import FrameSource
from handtrack.capture.masks.mask_cleaning import Roi, clean
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import above, at_least

_LEAST_FRAMES = 3
_MAD_TO_SIGMA = 1.4826
_LEAST_NOISE = 2.0  # 8 bit levels of Lab: rounding, compression
_ROWS_AT_ONCE = 64  # bounds the memory of the median


@dataclass(frozen=True)
class BackgroundMedian:
    """What is far from the recording's median image, in units of each pixel's own noise."""

    name: ClassVar[str] = "background_median"
    needs: ClassVar[str] = "images"

    samples: Annotated[int, at_least(_LEAST_FRAMES)] = 25
    """frames, evenly spaced over the recording, whose median is the background."""
    threshold: Annotated[float, above(0, "standard deviations")] = 8.0
    """difference in the worst channel of Lab (8 bit), in robust standard deviations of the pixel."""
    open_px: Annotated[int, at_least(0)] = 5
    """side of the square of the opening [px]; 0 for none."""
    largest: bool = True
    """keep only the largest component."""

    def segmenter(
        self, source: FrameSource, roi: Roi | None = None, unit_m: float = 1.0
    ) -> Callable[[Array[H, W, D3]], Bytes[H, W]]:
        """Return the function from a BGR image to its mask.

        Raises HandtrackError with fewer than 3 readable frames.
        """
        stack = np.stack([_lab(image) for image in sampled_images(source, self.samples)])
        median = np.empty(stack.shape[1:], np.float32)
        limit = np.empty(stack.shape[1:], np.float32)
        for row in range(0, stack.shape[1], _ROWS_AT_ONCE):
            part = slice(row, row + _ROWS_AT_ONCE)
            median[part] = np.median(stack[:, part], axis=0)
            noise = _MAD_TO_SIGMA * np.median(np.abs(stack[:, part] - median[part]), axis=0)
            limit[part] = self.threshold * np.maximum(noise, _LEAST_NOISE)

        def segment(image: Array) -> Bytes:
            moved = (np.abs(_lab(image) - median) > limit).any(axis=-1)
            return clean(np.where(moved, 255, 0).astype(np.uint8), self.open_px, self.largest, roi)

        return segment


@dataclass(frozen=True)
class BackgroundMog2:
    """OpenCV's mixture of Gaussians (MOG2), learned from sampled frames once and then held fixed.

    So a frame's mask does not depend on which frames were looked at before it.
    """

    name: ClassVar[str] = "background_mog2"
    needs: ClassVar[str] = "images"

    samples: Annotated[int, at_least(_LEAST_FRAMES)] = 100
    """frames, evenly spaced over the recording, that the mixture learns from."""
    threshold: Annotated[float, above(0, "variances")] = 16.0
    """squared distance, in variances, from which a pixel no longer belongs to the background."""
    shadows: bool = True
    """take darkened background for shadow, not for hand."""
    open_px: Annotated[int, at_least(0)] = 5
    """side of the square of the opening [px]; 0 for none."""
    largest: bool = True
    """keep only the largest component."""

    def segmenter(
        self, source: FrameSource, roi: Roi | None = None, unit_m: float = 1.0
    ) -> Callable[[Array[H, W, D3]], Bytes[H, W]]:
        """Return the function from a BGR image to its mask.

        Raises HandtrackError with fewer than 3 readable frames.
        """
        mixture = cv2.createBackgroundSubtractorMOG2(self.samples, self.threshold, self.shadows)
        for image in sampled_images(source, self.samples):
            mixture.apply(image)
        lock = threading.Lock()

        def segment(image: Array) -> Bytes:
            with lock:
                moved = mixture.apply(image, learningRate=0.0)
            hand = np.where(moved == 255, 255, 0).astype(np.uint8)  # 127 is shadow
            return clean(hand, self.open_px, self.largest, roi)

        return segment


def sampled_images(source: FrameSource, count: int) -> Iterator[Array[H, W, D3]]:
    """Yield up to `count` images evenly spaced over a recording.

    Raises HandtrackError with fewer than 3.
    """
    wanted = np.unique(np.linspace(0, max(len(source.frames) - 1, 0), count).round().astype(int))
    found = 0
    for frame in wanted:
        image = source.read(int(frame))
        if image is not None:
            found += 1
            yield image
    if found < _LEAST_FRAMES:
        raise HandtrackError(
            f"{source.where}: a background needs at least {_LEAST_FRAMES} readable images among "
            f"{len(wanted)} sampled frames; found {found}."
        )


def _lab(image: Array) -> Array:
    return cv2.cvtColor(image, cv2.COLOR_BGR2Lab)
