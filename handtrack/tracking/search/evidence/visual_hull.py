"""The visual hull: where in space all silhouettes agree that something may be, carved from coarse to fine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import D3, Array, Floats, N, array_dataclass
from handtrack.geometry.camera import Camera
from handtrack.geometry.triangulation import triangulated
from handtrack.observation.observation import Silhouette

_REACH_M = 0.4  # of the box around where the lines of sight meet: a hand and some arm
_SIDE_M = 0.01  # of a cell; twice that in the coarse grid, whose cells are halved
HAND_AREA_M2 = 0.012
"""of an open hand's outline: tells how deep it is where one camera alone sees it"""
_DEPTHS = (0.6, 1.6)


@array_dataclass
class VisualHull:
    """Cells that project into every silhouette that could see them."""

    centres: Floats[N, D3]
    """world [m]"""
    depth: Floats[N]
    """how far inside the hull each lies, about [m]"""
    side: float
    """of a cell [m]"""


def visual_hull(silhouettes: Sequence[Silhouette]) -> VisualHull:
    """Return the hull of what the silhouettes show, cells of a centimetre; without cells where they disagree.

    A camera that a cell lies outside of says nothing about it; at least two must see it, or the only one there is.
    """
    from scipy.ndimage import distance_transform_edt

    seen = [s for s in silhouettes if (s.mask > 0.5).any()]
    if not seen:
        return VisualHull(np.zeros((0, 3)), np.zeros(0), _SIDE_M)
    outside: list[Floats] = [
        np.asarray(distance_transform_edt((s.mask <= 0.5) & (s.mask >= 0))) for s in seen
    ]
    cameras = [s.camera for s in seen]
    middle = _meeting_point(seen)
    coarse_m = 2.0 * _SIDE_M
    axis = np.arange(-_REACH_M, _REACH_M + 0.5 * coarse_m, coarse_m)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3) + middle
    if len(seen) == 1:
        far = np.linalg.norm(middle - cameras[0].centre)
        depth = cameras[0].to_camera(grid)[:, 2]
        grid = grid[(depth > _DEPTHS[0] * far) & (depth < _DEPTHS[1] * far)]
    coarse = grid[_inside(grid, cameras, outside, 0.87 * coarse_m)]
    halves = 0.5 * _SIDE_M * np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), -1)
    fine = (coarse[:, None] + halves.reshape(-1, 3)).reshape(-1, 3)
    fine = fine[_inside(fine, cameras, outside, 0.5 * _SIDE_M)]
    return VisualHull(fine, _depth(fine), _SIDE_M)


def _inside(
    points: Floats, cameras: Sequence[Camera], outside: Sequence[Floats], margin_m: float
) -> Array:
    """Return (N,) whether points lie within margin_m of all silhouettes that can see them."""
    keep, views = np.ones(len(points), bool), np.zeros(len(points), int)
    for camera, far in zip(cameras, outside, strict=True):
        depth = camera.to_camera(points)[:, 2]
        pixel = np.rint(np.nan_to_num(camera.project(points), nan=-1.0)).astype(int)
        width, height = camera.size
        within = (depth > 0) & (pixel >= 0).all(axis=1)
        within &= (pixel[:, 0] < width) & (pixel[:, 1] < height)
        margin = margin_m * float(camera.matrix[0, 0]) / np.maximum(depth, 1e-6)
        column, row = np.clip(pixel[:, 0], 0, width - 1), np.clip(pixel[:, 1], 0, height - 1)
        keep &= ~within | (far[row, column] <= margin)
        views += within
    return keep & (views >= min(2, len(cameras)))


def _meeting_point(seen: Sequence[Silhouette]) -> Floats:
    """Return (3,) the point nearest to the lines of sight of the silhouettes' middles, world [m]; NaN where they look along one line.

    With one camera, the point on its line at which the silhouette has a hand's area.
    """
    shown = [np.argwhere(silhouette.mask > 0.5)[:, ::-1] for silhouette in seen]
    middles = np.array([np.median(pixels, axis=0) for pixels in shown])
    cameras = [silhouette.camera for silhouette in seen]
    if len(seen) > 1:
        return triangulated(cameras, middles[:, None], 0.0)[0]
    per_rad = cameras[0].matrix[0, 0] * cameras[0].matrix[1, 1]
    depth = np.sqrt(HAND_AREA_M2 * per_rad / len(shown[0]))
    return cameras[0].centre + cameras[0].rays(middles[0]) * depth


def _depth(centres: Floats) -> Floats:
    from scipy.ndimage import distance_transform_edt

    if not len(centres):
        return np.zeros(0)
    low = centres.min(axis=0) - _SIDE_M
    cell = np.rint((centres - low) / _SIDE_M).astype(int)
    filled = np.zeros(tuple(cell.max(axis=0) + 2), bool)
    filled[tuple(cell.T)] = True
    return np.asarray(distance_transform_edt(filled))[tuple(cell.T)] * _SIDE_M - 0.5 * _SIDE_M
