"""PointCloud: measured points with colours, as frozen data; and those of depth images."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from handtrack.arrays import (
    D3,
    Array,
    Axes,
    Bytes,
    Floats,
    H,
    N,
    W,
    array_dataclass,
    check_shape,
    pixel_grid,
)
from handtrack.geometry.camera import Camera


@array_dataclass
class PointCloud:
    """Measured surface points. Raises HandtrackError when the shapes do not fit."""

    points: Floats[N, D3]
    """world [m]."""
    colors: Array[N, D3] | None = None
    """uint8 RGB."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", np.asarray(self.points))
        check_shape(self.points, (None, 3), "points of a cloud")
        if self.colors is not None:
            check_shape(self.colors, (len(self.points), 3), "colors of a cloud")

    def __len__(self) -> int:
        return len(self.points)

    def select(self, keep: Array[*Axes]) -> PointCloud:
        """Return the points of a mask (N,) or of indices (M,), with their colours."""
        colors = None if self.colors is None else self.colors[keep]
        return PointCloud(self.points[keep], colors)


EMPTY = PointCloud(np.zeros((0, 3)))
"""An observation of nothing; a cloud that was not taken is None."""


def merged(clouds: Sequence[PointCloud]) -> PointCloud:
    """Return one cloud of several; it has colours when every cloud with points has them."""
    filled = [cloud for cloud in clouds if len(cloud)]
    if not filled:
        return EMPTY
    colors = [cloud.colors for cloud in filled if cloud.colors is not None]
    return PointCloud(
        np.concatenate([cloud.points for cloud in filled]),
        np.concatenate(colors) if len(colors) == len(filled) else None,
    )


# ---- Depth images → point clouds, without lens distortion, flying pixels and grazing surfaces


_NEIGHBOURS = ((0, 1), (1, 1), (1, 0), (1, -1))  # each pair of neighbours once


def surface_pixels(
    depth_m: Array[H, W],
    focal_px: float,
    grazing_deg: float = 80.0,
    jump_share: float = 0.008,
    support: int = 4,
) -> Array[H, W]:
    """Return where a depth image [m] shows a surface: where neighbouring pixels belong to one.

    Seen at the angle t from its normal, a surface changes by z / f tan t from pixel to pixel; the
    sensor's noise comes on top. A larger step is a jump. A pixel mixed of front and back (flying)
    hangs between two jumps, so that few neighbours support it.

    Parameters
    ----------
    depth_m
        0, negative and infinite depths are no measurement
    grazing_deg
        angle between viewing ray and surface normal from which on a surface does not count
    jump_share
        steps that noise may make, as a share of the depth: 4 mm at 0.5 m
    support
        neighbours of eight, on the same surface, that a pixel needs
    """
    depth = np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, 0.0)
    depth = np.pad(depth.astype(np.float32), 1)  # around it there is no measurement
    slope = np.float32(np.tan(np.radians(grazing_deg)) / focal_px)
    supported = np.zeros(depth.shape, np.int8)
    height, width = depth_m.shape
    here = slice(1, -1), slice(1, -1)
    for down, right in _NEIGHBOURS:
        there = slice(1 + down, 1 + down + height), slice(1 + right, 1 + right + width)
        a, b = depth[here], depth[there]
        limit = np.minimum(a, b) * (jump_share + slope * np.hypot(down, right))
        # 0 is no measurement: the limit is 0 beside it, and of two of them the last line takes neither
        together = np.abs(a - b) <= limit
        supported[here] += together
        supported[there] += together
    return ((supported >= support) & (depth > 0))[here]


def depth_cloud(
    camera: Camera,
    depth_m: Array[H, W],
    mask: Array[H, W] | None = None,
    image: Bytes[H, W, D3] | None = None,
    support: int = 4,
) -> PointCloud:
    """Return the points of a depth image [m] in the world frame.

    Depth is z in the camera, as depth cameras give it; 0 is no measurement.

    Parameters
    ----------
    mask
        Only pixels > 0 are used.
    image
        uint8 BGR in the same pixels, for colours.
    support
        See `surface_pixels`.

    Raises
    ------
    HandtrackError
        When a size differs from the camera's.
    """
    width, height = camera.size
    check_shape(depth_m, (height, width), f"depth of camera '{camera.name}'")
    keep = surface_pixels(depth_m, float(camera.matrix[0, 0]), support=support)
    if mask is not None:
        check_shape(mask, (height, width), f"mask of camera '{camera.name}'")
        keep &= mask > 0
    directions = _directions(camera)
    keep &= np.isfinite(directions[..., 0])
    rows, columns = np.nonzero(keep)
    depth = np.asarray(depth_m[rows, columns], dtype=float)
    flat = directions[rows, columns]
    in_camera = np.column_stack([flat * depth[:, None], depth])
    points = (in_camera - camera.translation) @ camera.rotation
    if image is None:
        return PointCloud(points)
    check_shape(image, (height, width, 3), f"image of camera '{camera.name}'")
    return PointCloud(points, image[rows, columns, ::-1].copy())


@lru_cache(maxsize=8)
def _directions(camera: Camera) -> Floats:
    """Return (H, W, 2) x/z and y/z of every pixel, distortion undone; NaN beyond the lens."""
    straight = camera.undistort_points(pixel_grid(camera.size))
    directions = (straight - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]
    directions.flags.writeable = False
    return directions
