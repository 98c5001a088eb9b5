"""Bring masks and images into the undistorted image once a frame, so that every term may use a plain pinhole."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from handtrack.arrays import D2, Array, Axes, Bytes, H, Ints, W, check_shape
from handtrack.geometry.camera import Camera
from handtrack.observation.observation import UNKNOWN, ImageView, Silhouette

Roi = tuple[int, int, int, int]
"""x, y, width, height [px] in the real, distorted image."""


class _Maps(NamedTuple):
    """What is computed once for a camera and a region of interest."""

    camera: Camera
    x: Array | None
    """(H, W) float32: the column in the real image of each undistorted pixel; None without distortion."""
    y: Array | None
    valid: Ints


def undistort_silhouette(
    camera: Camera, mask: Bytes[H, W], roi: Roi | None = None, unknown: int | None = None
) -> Silhouette:
    """Return the silhouette of a mask uint8, 0 background to 255 hand, of the real image.

    Each undistorted pixel holds its coverage, bilinearly interpolated. A row's valid span is the
    largest run of pixels that come from inside the image and the region of interest. Without
    distortion the mask passes unchanged. unknown: the mask's value where nobody can tell; nor can
    anybody of an undistorted pixel to which one of them adds.
    """
    width, height = camera.size
    check_shape(mask, (height, width), f"mask of camera '{camera.name}'")
    maps = _maps(camera, roi)
    coverage = mask.astype(np.float32) / np.float32(255)
    if maps.x is not None and maps.y is not None:
        coverage = cv2.remap(
            coverage, maps.x, maps.y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
    if unknown is not None:
        unsure = (mask == unknown).astype(np.float32)
        if maps.x is not None and maps.y is not None:
            unsure = cv2.remap(
                unsure, maps.x, maps.y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
        coverage[unsure > 0] = UNKNOWN
    coverage.flags.writeable = False
    return Silhouette(maps.camera, coverage, maps.valid)


def undistort_image(camera: Camera, pixels: Array[H, W, *Axes]) -> ImageView:
    """Return an image (H, W, 3) uint8 BGR as the camera without distortion would have taken it."""
    width, height = camera.size
    check_shape(pixels, (height, width, 3), f"image of camera '{camera.name}'")
    maps = _maps(camera, None)
    if maps.x is not None and maps.y is not None:
        pixels = cv2.remap(
            pixels, maps.x, maps.y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
    return ImageView(maps.camera, pixels)


@lru_cache(maxsize=32)
def _maps(camera: Camera, roi: Roi | None) -> _Maps:
    width, height = camera.size
    straight = camera.without_distortion()
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    pixels = np.stack([columns, rows], axis=-1).astype(float)
    source = camera.distort_points(pixels) if camera.is_distorted else pixels
    inside = _inside(source, (0, 0, width, height)) & _inside(source, roi or (0, 0, width, height))
    valid = longest_runs(inside)
    valid.flags.writeable = False
    if not camera.is_distorted:
        return _Maps(straight, None, None, valid)
    # beyond the lens's field the source is NaN; any place will do, since those pixels are not valid
    maps = np.nan_to_num(source, nan=-1e4).astype(np.float32)
    return _Maps(
        straight, np.ascontiguousarray(maps[..., 0]), np.ascontiguousarray(maps[..., 1]), valid
    )


def _inside(source: Array, box: Roi) -> Array:
    """Return where source points (H, W, 2) lie in a box of whole pixels (a pixel reaches half a
    unit each way)."""
    x, y, width, height = box
    low, high = np.array([x, y]) - 0.5, np.array([x + width, y + height]) - 0.5
    return np.asarray(((source >= low) & (source < high)).all(axis=-1))


def longest_runs(inside: Array[H, W]) -> Ints[H, D2]:
    """Return per row of booleans the longest run of true, half-open, as int32; the first of equals."""
    height, width = inside.shape
    position = np.arange(1, width + 1)
    last_outside = np.maximum.accumulate(np.where(inside, 0, position), axis=1)
    length = np.where(inside, position - last_outside, 0)
    end = np.argmax(length, axis=1) + 1
    longest = length[np.arange(height), end - 1]
    runs = np.stack([end - longest, end], axis=1)
    runs[longest == 0] = 0
    return runs.astype(np.int32)  # type: ignore[return-value]
