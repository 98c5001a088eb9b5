"""Meshes as cameras see them: masks, and what is wrong with real ones."""

from __future__ import annotations

import cv2
import numpy as np

from handtrack import Camera
from handtrack.arrays import D3, Array, Floats, H, M, N, W

_FINE = 16  # sub-pixel places of OpenCV's polygons, as a power of two: 4 bits
_SHIFT = 4


def outline(camera: Camera, vertices: Floats[N, D3], triangles: Array[M, D3]) -> Array[H, W]:
    """Return the silhouette, uint8 0 or 255."""
    width, height = camera.size
    mask = np.zeros((height, width), np.uint8)
    corners = np.round(camera.project(vertices)[triangles] * _FINE).astype(np.int32)
    for corner in corners:
        cv2.fillConvexPoly(mask, corner, 255, cv2.LINE_8, _SHIFT)
    return mask


def ragged(mask: Array[H, W], rng: np.random.Generator) -> Array[H, W]:
    """Return the mask as a colour threshold gives it: an edge that wanders by about 0.7 px, small bites and holes."""
    noise = cv2.GaussianBlur(rng.normal(size=mask.shape), (0, 0), 3.0)
    noise *= 0.7 / noise.std()
    inside = cv2.distanceTransform(mask, cv2.DIST_L2, 5)
    outside = cv2.distanceTransform(255 - mask, cv2.DIST_L2, 5)
    found = np.where(inside - outside > noise, 255, 0).astype(np.uint8)
    rows, columns = np.nonzero(found)
    for _ in range(rng.integers(0, 3)):
        i = rng.integers(len(rows))
        cv2.circle(found, (int(columns[i]), int(rows[i])), int(rng.integers(1, 3)), 0, -1)
    return found
