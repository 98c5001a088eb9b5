"""Observation: all that was seen of one frame, as frozen data (silhouettes, images, keypoints, a cloud)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D2, D3, Array, Floats, H, Ints, J, K, W
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.geometry.camera import Camera
from handtrack.observation.pins import ImagePins

UNKNOWN = np.float32(-1.0)
"""in a silhouette's mask: hand or background, nobody knows; the lowest of its values, and the only one below 0"""


@dataclass(frozen=True, eq=False)
class Silhouette:
    """Where one camera saw the hand, in the pixels of its undistorted image."""

    camera: Camera
    """without distortion; its size is the mask's."""
    mask: Array[H, W]
    """float32 in [0, 1]: how much of each undistorted pixel the hand covers; UNKNOWN where nobody can tell, which counts as
    little as what was not observed."""
    valid: Ints[H, D2]
    """int32: per row the half-open column span that was really observed; equal ends where none."""
    off_px: float = 0.0
    """how far the outline is off, beyond what outlines usually are, as the other cameras tell: it weighs less by that"""

    @property
    def known(self) -> Array[H, W]:
        """Whether each pixel was observed, and is known to be hand or background."""
        column = np.arange(self.mask.shape[1])
        seen = (column >= self.valid[:, :1]) & (column < self.valid[:, 1:])
        return seen & (self.mask >= 0)


@dataclass(frozen=True, eq=False)
class ImageView:
    """What one camera saw, undistorted."""

    camera: Camera
    """without distortion; its size is the image's."""
    pixels: Array[H, W, D3]
    """uint8, BGR; beyond the real image its border goes on"""


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Points of the hand in space, by joint name."""

    names: tuple[str, ...]
    positions: Floats[J, D3]
    """world [m], NaN where unknown."""
    sigma_m: float


@dataclass(frozen=True, eq=False)
class ImageKeypoints:
    """Points of the hand in one camera's undistorted image, by joint name."""

    camera: Camera
    names: tuple[str, ...]
    pixels: Floats[J, D2]
    """[px], NaN where unknown."""
    sigma_px: float
    confidence: Floats[J] | None = None
    """as the detector states it, 0 to 1; None where it was not kept"""


@dataclass(frozen=True, eq=False)
class Observation:
    """One frame of a session. A view that is missing is simply absent."""

    frame: int
    time_s: float
    silhouettes: tuple[Silhouette, ...] = ()
    keypoints: tuple[Keypoints | ImageKeypoints, ...] = ()
    cloud: PointCloud | None = None
    cloud_views: tuple[Floats[K, D3], ...] = ()
    """what can have seen the cloud's points: camera centres, world [m], that must all see one"""
    images: tuple[ImageView, ...] = ()
    """only where edges or intensity are looked at"""
    pins: tuple[ImagePins, ...] = ()
    """where a person said that joints and segments lie"""
