"""Meshes as cameras see them: depth by a z-buffer, masks, and what is wrong with real ones."""

from __future__ import annotations

import cv2
import numpy as np

from handtrack.arrays import D2, D3, Array, Floats, H, M, N, W
from handtrack.geometry.camera import Camera

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


def depth(camera: Camera, vertices: Floats[N, D3], triangles: Array[M, D3]) -> Floats[H, W]:
    """Return the depth [m] along z, 0 where there is nothing; the camera has no distortion."""
    width, height = camera.size
    found = np.full((height, width), np.inf)
    pixels, z = camera.project(vertices), camera.to_camera(vertices)[:, 2]
    for corners, inverse in zip(pixels[triangles], 1.0 / z[triangles], strict=True):
        _fill(found, corners, inverse)
    return np.where(np.isfinite(found), found, 0.0)


def _fill(found: Floats[H, W], corners: Floats[D3, D2], inverse: Floats[D3]) -> None:
    """Draw one triangle: 1/z is linear in the image."""
    low = np.maximum(np.ceil(corners.min(axis=0)), 0).astype(int)
    high = np.minimum(np.floor(corners.max(axis=0)), np.array(found.shape[::-1]) - 1).astype(int)
    if (low > high).any():
        return
    u, v = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    (ax, ay), (bx, by), (cx, cy) = corners
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if abs(area) < 1e-9:
        return
    p = ((bx - u) * (cy - v) - (cx - u) * (by - v)) / area
    q = ((cx - u) * (ay - v) - (ax - u) * (cy - v)) / area
    inside = (p >= 0) & (q >= 0) & (p + q <= 1)
    z = 1.0 / (p * inverse[0] + q * inverse[1] + (1 - p - q) * inverse[2])
    window = found[low[1] : high[1] + 1, low[0] : high[0] + 1]
    window[...] = np.where(inside, np.minimum(window, z), window)


def ragged(mask: Array[H, W], rng: np.random.Generator) -> Array[H, W]:
    """Return the mask as a colour threshold gives it: an edge that wanders by about 1.3 px, small bites and holes."""
    noise = cv2.GaussianBlur(rng.normal(size=mask.shape), (0, 0), 3.0)
    noise *= 1.3 / noise.std()
    inside = cv2.distanceTransform(mask, cv2.DIST_L2, 5)
    outside = cv2.distanceTransform(255 - mask, cv2.DIST_L2, 5)
    found = np.where(inside - outside > noise, 255, 0).astype(np.uint8)
    rows, columns = np.nonzero(found)
    for _ in range(rng.integers(0, 3)):
        i = rng.integers(len(rows))
        cv2.circle(found, (int(columns[i]), int(rows[i])), int(rng.integers(2, 5)), 0, -1)
    return found


def noisy(
    depths: Floats[H, W], rng: np.random.Generator, sigma_m: float = 0.0015, shift_m: float = 0.001
) -> Floats[H, W]:
    """Return depths [m] with noise of their own and errors alike over about 8 px; edges are ragged, as a camera's are."""
    seen = depths > 0
    wave = cv2.GaussianBlur(rng.normal(size=depths.shape), (0, 0), 8.0)
    found = depths + sigma_m * rng.normal(size=depths.shape) + shift_m * wave / wave.std()
    edge = seen & ~cv2.erode(seen.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    found[edge & (rng.random(depths.shape) < 0.5)] = 0.0
    return np.where(seen, found, 0.0)


def damaged(depths: Floats[H, W], rng: np.random.Generator) -> Floats[H, W]:
    """Return depths of which 30 % are missing, in regions of about 20 px, and 20 % are wrong by 2 to 15 cm."""
    region = cv2.GaussianBlur(rng.normal(size=depths.shape), (0, 0), 10.0)
    seen = depths > 0
    gone = seen & (region > np.quantile(region[seen], 0.7)) if seen.any() else seen
    found = np.where(gone, 0.0, depths)
    wrong = (found > 0) & (rng.random(depths.shape) < 0.2)
    off = rng.choice([-1.0, 1.0], depths.shape) * rng.uniform(0.02, 0.15, depths.shape)
    return np.where(wrong, found + off, found)
