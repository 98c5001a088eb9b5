"""Bring masks and images into the undistorted image once a frame, so that every term may use a plain pinhole."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import Array, Axes, Bytes, H, W, check_shape
from handtrack.geometry.camera import Camera
from handtrack.observation.lens_maps import Roi, lens_maps
from handtrack.observation.observation import UNKNOWN, ImageView, Silhouette


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
    maps = lens_maps(camera, roi)
    coverage = maps.straightened(mask.astype(np.float32) / np.float32(255))
    if unknown is not None:
        unsure = maps.straightened((mask == unknown).astype(np.float32))
        coverage[unsure > 0] = UNKNOWN
    coverage.flags.writeable = False
    return Silhouette(maps.camera, coverage, maps.valid)


def undistort_image(camera: Camera, pixels: Array[H, W, *Axes]) -> ImageView:
    """Return an image (H, W, 3) uint8 BGR as the camera without distortion would have taken it."""
    width, height = camera.size
    check_shape(pixels, (height, width, 3), f"image of camera '{camera.name}'")
    maps = lens_maps(camera)
    return ImageView(maps.camera, maps.straightened(pixels))
