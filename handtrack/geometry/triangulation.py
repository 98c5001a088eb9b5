"""Points in space from where several cameras see them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import D2, D3, C, Floats, N
from handtrack.geometry.camera import Camera

_ROUNDS = 30  # 99 % of a real hand's joints move by less than 0.2 mm in another 270
_LEAST_ANGLE = 0.01  # [rad] between lines of sight: of less, noise decides where they meet


def triangulated(
    cameras: Sequence[Camera],
    pixels: Floats[C, N, D2],
    least_angle: float = _LEAST_ANGLE,
    weights: Floats[C, N] | None = None,
) -> Floats[N, D3]:
    """Return points nearest to their lines of sight, world [m]; NaN where fewer than two cameras see one, or from one side.

    pixels: of the undistorted images, NaN where unknown. least_angle: between two of the lines [rad]. Least squares over the
    distances from the lines, weighted by `weights` where given.
    """
    ways = np.stack([one.rays(seen) for one, seen in zip(cameras, pixels, strict=True)])
    known = np.asarray(np.isfinite(ways).all(axis=2))
    ways = np.where(known[..., None], ways, 0.0)
    across = known[..., None, None] * np.eye(3) - ways[..., :, None] * ways[..., None, :]
    centres = np.stack([camera.centre for camera in cameras])
    # the smallest eigenvalue of two lines' matrix is 1 − cos of their angle
    narrow = np.linalg.eigvalsh(across.sum(axis=0))[:, 0] < 1.0 - np.cos(least_angle)
    across = across if weights is None else across * weights[..., None, None]
    total = across.sum(axis=0)
    total[narrow] = np.eye(3)
    points = np.linalg.solve(total, np.einsum("cnij,cj->ni", across, centres)[..., None])[..., 0]
    points[narrow] = np.nan
    return points


def robustly_triangulated(
    cameras: Sequence[Camera], pixels: Floats[C, N, D2], scale_px: float
) -> Floats[N, D3]:
    """Return points whose images are nearest to where cameras see them, world [m]; NaN as `triangulated` has it.

    Cauchy's loss of the distances in the images, ½ s² log(1 + (r/s)²) with s = scale_px: beyond that, a camera counts for ever
    less. Reweighted least squares from the plain solution, where a distance from a line of sight is depth / focal length
    times that in the image.
    """
    points = triangulated(cameras, pixels)
    focal = np.array([np.sqrt(np.prod(np.diag(camera.matrix)[:2])) for camera in cameras])
    for _ in range(_ROUNDS):
        depth = np.stack([camera.to_camera(points)[:, 2] for camera in cameras])
        missed = missed_px(cameras, pixels, points)
        with np.errstate(invalid="ignore", divide="ignore"):
            weights = (focal[:, None] / depth) ** 2 / (1.0 + (missed / scale_px) ** 2)
        points = triangulated(cameras, pixels, weights=np.nan_to_num(weights, posinf=0.0))
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
