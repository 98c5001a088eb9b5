"""Render posed ellipsoids exactly as a camera with its lens sees them."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, Array, E, Floats, H, W, pixel_grid
from handtrack.geometry.camera import Camera
from handtrack.model.ellipsoids import Ellipsoids

_LIGHT = np.array([-0.35, -0.6, -0.72])  # camera axes: from the upper left, behind the camera


def pixel_rays(camera: Camera) -> Floats[H, W, D3]:
    """Return directions, z = 1, camera axes, of all pixel centres, distortion undone."""
    width, height = camera.size
    pixels = camera.undistort_points(pixel_grid(camera.size).reshape(-1, 2))
    homogeneous = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1)
    return (homogeneous @ np.linalg.inv(camera.matrix).T).reshape(height, width, 3)


def render(
    camera: Camera, ellipsoids: Ellipsoids, rays: Floats[H, W, D3] | None = None
) -> tuple[Array[H, W], Floats[H, W], Floats[H, W, D3]]:
    """Return which ellipsoid is in front (H, W; −1 for none), its depth [m] and normals.

    Exact at pixel centres: each ray is cut with each ellipsoid. Depth is z in the camera, 0 where
    there is none.

    Parameters
    ----------
    rays
        From `pixel_rays`, to be made once per camera.
    """
    rays = pixel_rays(camera) if rays is None else rays
    height, width = rays.shape[:2]
    front = np.full((height, width), -1)
    depth = np.full((height, width), np.inf)
    normal = np.zeros((height, width, 3))
    centres: Floats[E, D3] = camera.to_camera(ellipsoids.centre)
    axes = camera.rotation @ ellipsoids.rotation
    for e, (centre, turn, radii) in enumerate(zip(centres, axes, ellipsoids.radii, strict=True)):
        window = _window(camera, rays, centre, float(radii.max()))
        if window is None:
            continue
        direction = rays[window] @ turn / radii
        origin = -(centre @ turn) / radii
        a = (direction**2).sum(axis=-1)
        b = direction @ origin
        inside = b * b - a * (origin @ origin - 1.0)
        hit = inside > 0
        z = (-b - np.sqrt(np.where(hit, inside, 0.0))) / a
        nearer = hit & (z > 0) & (z < depth[window])
        depth[window] = np.where(nearer, z, depth[window])
        front[window] = np.where(nearer, e, front[window])
        local = (origin + direction * z[..., None]) / radii
        world = local @ turn.T
        world /= np.maximum(np.linalg.norm(world, axis=-1, keepdims=True), 1e-12)
        normal[window] = np.where(nearer[..., None], world, normal[window])
    return front, np.where(front >= 0, depth, 0.0), normal


def shade(
    front: Array[H, W], normal: Floats[H, W, D3], colors: Array[E, D3], background: Array[H, W, D3]
) -> Array[H, W, D3]:
    """Return a picture uint8: each ellipsoid in its colour, lit from the upper left."""
    light = np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)
    lit = colors[np.maximum(front, 0)] * (0.35 + 0.65 * light[..., None])
    return np.where((front >= 0)[..., None], lit, background).astype(np.uint8)


def _window(camera: Camera, rays: Floats, centre: Floats, radius: float):
    """Return the rows and columns that a ball around an ellipsoid can reach, or None."""
    if centre[2] <= radius:
        return None
    reach = (
        radius
        / np.sqrt(centre[2] ** 2 - radius**2)
        * np.hypot(1.0, np.hypot(*centre[:2]) / centre[2])
    )
    near = (np.abs(rays[..., 0] - centre[0] / centre[2]) < 1.5 * reach) & (
        np.abs(rays[..., 1] - centre[1] / centre[2]) < 1.5 * reach
    )
    rows, columns = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
    if not len(rows):
        return None
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
