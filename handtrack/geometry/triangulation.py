"""Points in space from where several cameras see them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import D2, D3, C, Floats, N
from handtrack.geometry.camera import Camera

_LEAST_ANGLE = 0.01  # [rad] between lines of sight: of less, noise decides where they meet


def triangulated(
    cameras: Sequence[Camera],
    pixels: Floats[C, N, D2],
    least_angle: float = _LEAST_ANGLE,
    weights: Floats[C, N] | None = None,
) -> Floats[N, D3]:
    """Return points nearest to their lines of sight, world [m]; NaN where fewer than two cameras
    see one, or from one side.

    Least squares over the distances from the lines, weighted by `weights` where given.

    Parameters
    ----------
    pixels
        Of the undistorted images, NaN where unknown.
    least_angle
        Between two of the lines [rad].
    """
    rays = np.stack([one.rays(seen) for one, seen in zip(cameras, pixels, strict=True)])
    known = np.asarray(np.isfinite(rays).all(axis=2))
    rays = np.where(known[..., None], rays, 0.0)
    across = known[..., None, None] * np.eye(3) - rays[..., :, None] * rays[..., None, :]
    centres = np.stack([camera.centre for camera in cameras])
    # the smallest eigenvalue of two lines' matrix is 1 − cos of their angle
    narrow = np.linalg.eigvalsh(across.sum(axis=0))[:, 0] < 1.0 - np.cos(least_angle)
    across = across if weights is None else across * weights[..., None, None]
    total = across.sum(axis=0)
    total[narrow] = np.eye(3)
    points = np.linalg.solve(total, np.einsum("cnij,cj->ni", across, centres)[..., None])[..., 0]
    points[narrow] = np.nan
    return points


def missed_px(
    cameras: Sequence[Camera], pixels: Floats[C, N, D2], points: Floats[N, D3]
) -> Floats[C, N]:
    """Return how far points (N, 3) are from where cameras see them [px]; NaN where unknown, infinite behind a camera."""
    missed = np.full(pixels.shape[:2], np.nan)
    for row, (camera, seen) in enumerate(zip(cameras, pixels, strict=True)):
        known = np.asarray(np.isfinite(seen).all(axis=1) & np.isfinite(points).all(axis=1))
        before = camera.to_camera(points[known])[:, 2] > 0
        off = np.full(len(before), np.inf)
        off[before] = np.linalg.norm(
            camera.project(points[known][before]) - seen[known][before], axis=1
        )
        missed[row, known] = off
    return missed
