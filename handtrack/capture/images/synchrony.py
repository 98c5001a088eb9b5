"""Estimate by how many frames one camera's recording is late against another's, from what moves.

A point in space lies in one plane through both cameras' centres. However the cameras stand, what moves at an angle of that
plane around the line between them moves at the same angle in the other's picture, at the same time.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from handtrack.arrays import D2, Array, Axes, B, Floats, H, L, Q, T, W
from handtrack.geometry.camera import Camera

_WIDTH = 192  # of the reduced pictures [px]
_BINS = 48  # planes told apart
_NOISE = 6.0  # grey levels: smaller changes are the sensor's
_LEAST_OVERLAP = 10  # frames that both show
_MOST_LATE = 12  # frames
_LEAST_ALIKE = 0.3
_LEAST_APART_M = 1e-4
_LEAST_GAIN = 0.1  # of the correlation, over that of the frames as numbered


@dataclass(frozen=True)
class Lag:
    """How the second camera's frames lie against the first's."""

    frames: int
    """by which the second is late; 0: not at all"""
    alike: float
    """correlation of what moves at that lag"""
    as_numbered: float
    """… and of frames of equal number"""


class Motion:
    """What moved from frame to frame in one camera's pictures, reduced."""

    def __init__(self, camera: Camera, pictures: Iterable[Array[H, W, *Axes] | None]) -> None:
        """pictures: of frames after one another, (H, W, 3) or (H, W) uint8, None where missing."""
        small = [None if p is None else _small(p) for p in pictures]
        self.camera = camera
        self.changes = [
            None if a is None or b is None else np.maximum(np.abs(b - a) - _NOISE, 0.0)
            for a, b in pairwise(small)
        ]

    def by_plane(self, angles: Floats[H, W], edges: Floats[Q]) -> Floats[B, T]:
        """Return how much moved in each range of angles; NaN where a frame is missing. angles: reduced."""
        bins = np.digitize(angles, edges).ravel()
        none = np.full(len(edges) + 1, np.nan)
        rows = [
            none if change is None else np.bincount(bins, change.ravel(), len(edges) + 1)
            for change in self.changes
        ]
        return np.array(rows)[:, 1:-1].T


def plane_angles(camera: Camera, other: Camera, pixels: Floats[*Axes, D2]) -> Floats[*Axes]:
    """Return (...) the angle of each pixel's plane through both centres [rad]; NaN where the lens shows nothing, or the
    centres are one.

    pixels: of the camera's real image. 0 is where the two look on average.
    """
    first, second = sorted((camera, other), key=lambda c: c.name)  # one line, one zero for both
    line = second.centre - first.centre
    length = float(np.linalg.norm(line))
    if length < _LEAST_APART_M:
        return np.full(pixels.shape[:-1], np.nan)
    line = line / length
    axis = first.rotation[2] + second.rotation[2]
    ahead = axis - (axis @ line) * line
    if np.linalg.norm(ahead) < 1e-6:  # they look at each other
        ahead = np.cross(line, first.rotation[0])
    ahead = ahead / np.linalg.norm(ahead)
    rays = camera.rays(pixels)
    return np.arctan2(rays @ np.cross(line, ahead), rays @ ahead)


def _grid(camera: Camera, shape: tuple[int, ...]) -> Floats:
    """Return (H, W, 2) the places in the real image of a reduced picture's pixels."""
    height, width = shape
    scale = camera.size[0] / width
    across, down = (np.arange(width) + 0.5) * scale - 0.5, (np.arange(height) + 0.5) * scale - 0.5
    return np.stack(np.meshgrid(across, down), axis=-1)


def lag_of(alike: Floats[D2, L]) -> Lag | None:
    """Return the lag that curves of two stretches of a recording show, see `agreement`; None where they cannot tell.

    It counts only where both stretches agree about it to a frame, and the pictures agree clearly better at it.
    """
    if np.isnan(alike[:, _MOST_LATE]).any():
        return None
    together = np.mean(alike, axis=0)
    best, *each = (int(np.argmax(curve)) - _MOST_LATE for curve in (together, *alike))
    as_numbered, at_best = float(together[_MOST_LATE]), float(together[best + _MOST_LATE])
    agree = all(lag * best > 0 and abs(lag - best) <= 1 for lag in each)
    if agree and at_best >= _LEAST_ALIKE and at_best - as_numbered >= _LEAST_GAIN:
        return Lag(best, at_best, as_numbered)
    return Lag(0, as_numbered, as_numbered)


def agreement(first: tuple[Motion, Motion], second: tuple[Motion, Motion]) -> Floats[D2, L]:
    """Return how well what moves in two stretches agrees at each lag of the second, −12 to 12 frames; NaN: unseen."""
    return np.stack([_alike(a, b) for a, b in zip(first, second, strict=True)])


def _alike(first: Motion, second: Motion) -> Floats:
    """Return (2 most + 1,) how well what moves agrees at each lag of the second; NaN where too little is seen to tell."""
    unknown = np.full(2 * _MOST_LATE + 1, np.nan)
    shapes = [next((c.shape for c in m.changes if c is not None), None) for m in (first, second)]
    if shapes[0] is None or shapes[1] is None:
        return unknown
    a, b = first.camera, second.camera
    angles = (
        plane_angles(a, b, _grid(a, shapes[0])),
        plane_angles(b, a, _grid(b, shapes[1])),
    )
    if not all(np.isfinite(part).any() for part in angles):
        return unknown
    low = max(float(np.nanmin(part)) for part in angles)
    high = min(float(np.nanmax(part)) for part in angles)
    if low >= high:
        return unknown
    edges = np.linspace(low, high, _BINS + 1)
    rows = [
        motion.by_plane(np.nan_to_num(part, nan=high + 1), edges)
        for motion, part in zip((first, second), angles, strict=True)
    ]
    lags = range(-_MOST_LATE, _MOST_LATE + 1)
    curve = np.array([_correlation(rows[0], rows[1], k) for k in lags])
    return unknown if np.isnan(curve[_MOST_LATE]) else np.nan_to_num(curve, nan=-1.0)


def _correlation(first: Floats, second: Floats, late: int) -> float:
    """Return how alike the changes over time are, the second `late` frames later: −1 to 1; NaN where they hardly overlap."""
    a = first[:, max(0, -late) : first.shape[1] - max(0, late)]
    b = second[:, max(0, late) : second.shape[1] - max(0, -late)]
    both = np.isfinite(a[0]) & np.isfinite(b[0]) if a.shape[1] else np.zeros(0, bool)
    if both.sum() < _LEAST_OVERLAP:
        return float("nan")
    a, b = (part[:, both] - part[:, both].mean(axis=1, keepdims=True) for part in (a, b))
    size = np.sqrt((a**2).sum() * (b**2).sum())
    return float((a * b).sum() / size) if size > 0 else float("nan")


def _small(picture: Array) -> Floats:
    height, width = picture.shape[:2]
    wide = min(_WIDTH, width)
    grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    size = (wide, max(1, round(height * wide / width)))
    return cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
