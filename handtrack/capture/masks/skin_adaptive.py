"""Mask method by skin colour learned from a sample of this recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Bytes, Floats, H, W
from handtrack.capture.images.frames import FrameSource
from handtrack.capture.masks.mask_cleaning import Roi, clean
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import above, at_least

_LEAST_SPREAD = 0.003  # of r and g: about one step of 8 bit colour at medium brightness
_TRIM = 3.0  # samples farther than this from the first fit are left out of the second


@dataclass(frozen=True)
class SkinAdaptive:
    """Skin as an ellipse in the chromaticities r = R/(R+G+B), g = G/(R+G+B), fitted to a sample box."""

    name: ClassVar[str] = "skin_adaptive"
    needs: ClassVar[str] = "images"

    sample: Roi
    """x, y, w, h [px]: a box that shows skin only, in the reference frame."""
    size: Annotated[float, above(0, "standard deviations")] = 3.0
    """size of the ellipse in standard deviations (Mahalanobis distance)."""
    reference: Annotated[int, at_least(0)] = 0
    """frame in which the sample lies."""
    y_min: Annotated[int, at_least(0)] = 40
    """least luminance; the chromaticity of dark pixels means nothing."""
    open_px: Annotated[int, at_least(0)] = 5
    """side of the square of the opening [px]; 0 for none."""
    largest: bool = True
    """keep only the largest component."""

    def __post_init__(self) -> None:
        x, y, width, height = self.sample
        if x < 0 or y < 0 or width < 2 or height < 2:
            raise ValueError(
                f"sample = {list(self.sample)}; expected a box of at least 2 x 2 pixels inside the image."
            )

    def segmenter(
        self, source: FrameSource, roi: Roi | None = None, unit_m: float = 1.0
    ) -> Callable[[Array[H, W, D3]], Bytes[H, W]]:
        """Return the function from a BGR image to its mask, fitted to the source's reference frame.

        Raises HandtrackError when that frame is missing or the sample leaves the image.
        """
        mean, inverse = self._fit(source)

        def segment(image: Array) -> Bytes:
            distance2 = _squared_distance(_chromaticity(image), mean, inverse)
            bright = cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb)[..., 0] >= self.y_min
            skin = np.where((distance2 <= self.size**2) & bright, 255, 0).astype(np.uint8)
            return clean(skin, self.open_px, self.largest, roi)

        return segment

    def _fit(self, source: FrameSource) -> tuple[Floats, Floats]:
        image = source.read(self.reference)
        if image is None:
            raise HandtrackError(
                f"{source.where}: mask method skin_adaptive takes its sample from frame "
                f"{self.reference}, which is missing; set `reference` to a frame that exists."
            )
        x, y, width, height = self.sample
        if x < 0 or y < 0 or x + width > image.shape[1] or y + height > image.shape[0]:
            raise HandtrackError(
                f"{source.where}: mask method skin_adaptive: sample = {list(self.sample)} leaves "
                f"the image of {image.shape[1]} x {image.shape[0]}."
            )
        colours = _chromaticity(image[y : y + height, x : x + width]).reshape(-1, 2)
        mean, inverse = _ellipse(colours)
        near = _squared_distance(colours, mean, inverse) <= _TRIM**2
        return _ellipse(colours[near])


def _chromaticity(image: Array) -> Array:
    """Return r and g (..., 2) float32 of a BGR image; 0 where black."""
    bgr = image.astype(np.float32)
    total = np.maximum(bgr.sum(axis=-1, keepdims=True), 1.0)
    return bgr[..., [2, 1]] / total


def _squared_distance(colours: Array, mean: Floats, inverse: Floats) -> Array:
    """Return the squared Mahalanobis distance (...) of colours (..., 2)."""
    r, g = colours[..., 0] - mean[0], colours[..., 1] - mean[1]
    return inverse[0, 0] * r * r + 2 * inverse[0, 1] * r * g + inverse[1, 1] * g * g


def _ellipse(colours: Array) -> tuple[Floats, Floats]:
    covariance = np.cov(colours.T.astype(float)) + _LEAST_SPREAD**2 * np.eye(2)
    inverse = np.asarray(np.linalg.inv(covariance), dtype=float)
    return colours.mean(axis=0, dtype=float), inverse
