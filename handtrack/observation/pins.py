"""Pins: what a person says by pointing at a camera's image. A joint, or a point of a segment, lies on that ray."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D2, Floats, K, array_dataclass
from handtrack.geometry.camera import Camera

PIN_SIGMA_PX = 0.3
"""how exactly a pin is kept: who points at a picture at its own size, or larger, means this pixel, and what thousands of others
say does not move it by one"""


@dataclass(frozen=True)
class Pin:
    """A place of the model, and where it lies in a camera's image."""

    camera: str
    pixel: tuple[float, float]
    """column and row [px] of the undistorted image"""
    joint: str = ""
    """the place, where it is a joint; else a point of a bone"""
    bone: str = ""
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """in the bone's frame [m]"""

    def is_on(self, joints: Sequence[str], bones: Sequence[str]) -> bool:
        """Return whether a model of these joints and bones has what is pinned: a simpler one may lack it."""
        return self.joint in joints or self.bone in bones

    @property
    def what(self) -> tuple[str, str, str, tuple[float, float, float]]:
        """What is pinned, in which camera's image: there is one of it in a frame."""
        return self.camera, self.joint, self.bone, self.point


@array_dataclass
class ImagePins:
    """The pins in one camera's undistorted image."""

    camera: Camera
    """without distortion"""
    pins: tuple[Pin, ...]

    @property
    def pixels(self) -> Floats[K, D2]:
        return np.array([pin.pixel for pin in self.pins], float).reshape(-1, 2)
