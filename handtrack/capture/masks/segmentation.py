"""Mask methods by fixed skin colour and by depth, and the table of all methods that session.toml may name."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Annotated, Any, get_args

import cv2
import numpy as np
from msgspec import Meta

from handtrack.arrays import D3, Array, Axes, Bytes, H, W, evenly_spread
from handtrack.capture.clouds.cloud_filters import fit_skin_ellipse
from handtrack.capture.images.frames import FrameSource
from handtrack.capture.masks.mask_correction import Cleaning, Roi
from handtrack.capture.masks.seeded import Seeded
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import above, at_least, checked_table, read_table, required

Segmenter = Callable[[Array[H, W, *Axes]], Array[H, W]]
"""image BGR or depth → what is hand, as bool or a mask {0, 255}"""


@dataclass(frozen=True)
class SkinAdaptive(Cleaning):
    """Skin as an ellipse in the chromaticities r = R/(R+G+B), g = G/(R+G+B), fitted to a sample box."""

    name = "skin_adaptive"
    needs = "images"

    sample: Roi
    """x, y, w, h [px]: a box that shows skin only, in the reference frame."""
    size: Annotated[float, above(0, "standard deviations")] = 3.0
    """size of the ellipse in standard deviations (Mahalanobis distance)."""
    reference: Annotated[int, at_least(0)] = 0
    """frame in which the sample lies."""
    y_min: Annotated[int, at_least(0)] = 40
    """least luminance; the chromaticity of dark pixels means nothing."""

    def __post_init__(self) -> None:
        x, y, width, height = self.sample
        if x < 0 or y < 0 or width < 2 or height < 2:
            raise ValueError(
                f"sample = {list(self.sample)}; expected a box of at least 2 x 2 pixels inside the image."
            )

    def learned(self, source: FrameSource, unit_m: float) -> Segmenter:
        """Return what tells skin in a BGR image, fitted to the source's reference frame.

        Raises HandtrackError when that frame is missing, the sample leaves the image, or fewer than 20 of its pixels have a colour.
        """
        image = source.read(self.reference)
        if image is None:
            raise HandtrackError(
                f"{source.where}: mask method skin_adaptive takes its sample from frame "
                f"{self.reference}, which is missing; set `reference` to a frame that exists."
            )
        x, y, width, height = self.sample
        if x + width > image.shape[1] or y + height > image.shape[0]:
            raise HandtrackError(
                f"{source.where}: mask method skin_adaptive: sample = {list(self.sample)} leaves "
                f"the image of {image.shape[1]} x {image.shape[0]}."
            )
        skin = fit_skin_ellipse(image[y : y + height, x : x + width, ::-1], size=self.size)

        def segment(image: Array) -> Array:
            away = skin.distance(image[..., ::-1].reshape(-1, 3)).reshape(image.shape[:2])
            bright = cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb)[..., 0] >= self.y_min
            return (away <= skin.size) & bright

        return segment


_LEAST_FRAMES = 3
_MAD_TO_SIGMA = 1.4826
_LEAST_NOISE = 2.0  # 8 bit levels of Lab: rounding, compression
_ROWS_AT_ONCE = 64  # bounds the memory of the median


@dataclass(frozen=True)
class BackgroundMedian(Cleaning):
    """What is far from the recording's median image, in units of each pixel's own noise."""

    name = "background_median"
    needs = "images"

    samples: Annotated[int, at_least(_LEAST_FRAMES)] = 25
    """frames, evenly spaced over the recording, whose median is the background."""
    threshold: Annotated[float, above(0, "standard deviations")] = 8.0
    """difference in the worst channel of Lab (8 bit), in robust standard deviations of the pixel."""

    def learned(self, source: FrameSource, unit_m: float) -> Segmenter:
        """Return what tells in a BGR image what is no background.

        Raises HandtrackError with fewer than 3 readable frames.
        """
        stack = np.stack([_lab(image) for image in sampled_images(source, self.samples)])
        median = np.empty(stack.shape[1:], np.float32)
        limit = np.empty_like(median)
        for row in range(0, stack.shape[1], _ROWS_AT_ONCE):
            part = slice(row, row + _ROWS_AT_ONCE)
            median[part] = np.median(stack[:, part], axis=0)
            noise = _MAD_TO_SIGMA * np.median(np.abs(stack[:, part] - median[part]), axis=0)
            limit[part] = self.threshold * np.maximum(noise, _LEAST_NOISE)

        def segment(image: Array) -> Array:
            return np.any(np.abs(_lab(image) - median) > limit, axis=-1)

        return segment


@dataclass(frozen=True)
class BackgroundMog2(Cleaning):
    """OpenCV's mixture of Gaussians (MOG2), learned from sampled frames once and then held fixed.

    So a frame's mask does not depend on which frames were looked at before it.
    """

    name = "background_mog2"
    needs = "images"

    samples: Annotated[int, at_least(_LEAST_FRAMES)] = 100
    """frames, evenly spaced over the recording, that the mixture learns from."""
    threshold: Annotated[float, above(0, "variances")] = 16.0
    """squared distance, in variances, from which a pixel no longer belongs to the background."""
    shadows: bool = True
    """take darkened background for shadow, not for hand."""

    def learned(self, source: FrameSource, unit_m: float) -> Segmenter:
        """Return what tells in a BGR image what is no background.

        Raises HandtrackError with fewer than 3 readable frames.
        """
        mixture = cv2.createBackgroundSubtractorMOG2(self.samples, self.threshold, self.shadows)
        for image in sampled_images(source, self.samples):
            mixture.apply(image)
        lock = threading.Lock()

        def segment(image: Array) -> Array:
            with lock:
                return mixture.apply(image, learningRate=0.0) == 255  # 127 is shadow

        return segment


def sampled_images(source: FrameSource, count: int) -> Iterator[Array[H, W, D3]]:
    """Yield up to `count` images evenly spaced over a recording.

    Raises HandtrackError with fewer than 3.
    """
    wanted = evenly_spread(len(source.frames), count)
    found = 0
    for frame in wanted:
        image = source.read(frame)
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


_Range = Annotated[tuple[int, int], Meta(description="2 whole numbers [least, most]")]


@dataclass(frozen=True)
class SkinYCrCb(Cleaning):
    """Skin as a box in YCrCb (8 bit, OpenCV's conversion)."""

    name = "skin_ycrcb"
    needs = "images"

    y_min: Annotated[int, at_least(0)] = 40
    """least luminance."""
    cr: _Range = (138, 175)
    """closed range of Cr."""
    cb: _Range = (85, 125)
    """closed range of Cb."""

    def __post_init__(self) -> None:
        for key, (low, high) in (("cr", self.cr), ("cb", self.cb)):
            if not 0 <= low <= high <= 255:
                raise ValueError(
                    f"{key} = [{low}, {high}]; expected least and most within 0 to 255, in this order."
                )

    def learned(self, source: FrameSource, unit_m: float) -> Segmenter:
        """Return what tells skin in a BGR image; nothing is learned from the source."""
        low = np.array([self.y_min, self.cr[0], self.cb[0]])
        high = np.array([255, self.cr[1], self.cb[1]])

        def segment(image: Array) -> Array:
            return cv2.inRange(cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb), low, high) > 0

        return segment


@dataclass(frozen=True, kw_only=True)
class DepthRange(Cleaning):
    """Whatever lies within a range of the camera's depth z."""

    name = "depth_range"
    needs = "depth"

    near_m: Annotated[float, above(0, "m")]
    """nearest depth that counts [m]."""
    far_m: Annotated[float, above(0, "m")]
    """farthest depth that counts [m]."""
    open_px: Annotated[int, at_least(0)] = 0
    largest: bool = False

    def __post_init__(self) -> None:
        if self.far_m <= self.near_m:
            raise ValueError(f"far_m = {self.far_m}; expected a number above {self.near_m:g} [m].")

    def learned(self, source: FrameSource, unit_m: float) -> Segmenter:
        """Return what tells the range in a depth image (H, W) uint16, unit_m metres a unit; 0 is no measurement."""

        def segment(depth: Array) -> Array:
            metres = depth * unit_m
            return (depth > 0) & (metres >= self.near_m) & (metres <= self.far_m)

        return segment


def segmenter(
    method: SkinYCrCb | SkinAdaptive | BackgroundMedian | BackgroundMog2 | DepthRange,
    source: FrameSource,
    roi: Roi | None = None,
    unit_m: float = 1.0,
) -> Callable[[Array[H, W, *Axes]], Bytes[H, W]]:
    """Return the function from a camera's images, or from depth of unit_m metres a unit, to masks {0, 255}, as the source teaches it.

    Raises HandtrackError where the source lacks what the method learns from.
    """
    shows = method.learned(source, unit_m)

    def segment(image: Array) -> Bytes:
        mask = np.where(shows(image), 255, 0).astype(np.uint8)
        return method.cleaned(mask, roi)

    return segment


MaskMethod = SkinYCrCb | SkinAdaptive | BackgroundMog2 | BackgroundMedian | DepthRange | Seeded
METHODS: dict[str, type[MaskMethod]] = {kind.name: kind for kind in get_args(MaskMethod)}


def read_mask_method(table: Any, where: str) -> MaskMethod:
    """Return the mask method of an inline table `{ method = "...", ... }`.

    Parameters
    ----------
    where
        File and table for the errors.

    Raises
    ------
    HandtrackError
        Naming the known methods or keys.
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
