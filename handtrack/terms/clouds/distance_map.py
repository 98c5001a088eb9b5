"""Distances to the cloud around the hand: a grid that knows where to look, made once a frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handtrack.arrays import D3, Array, Floats, M, N, X, Y, Z, check_shape
from handtrack.errors import HandtrackError
from handtrack.terms.clouds.distance_map_kernels import (
    fill_cells,
    fill_nearest,
    look_up,
)

SPACING_M = 0.006
MOST_VOXELS = 8_000_000
"""The grid gets coarser rather than larger; about 150 MB are in use while this many are computed."""


class DistanceMap(NamedTuple):
    """Unsigned distances to a cloud: to the nearest of the points in those cells that are nearest to the 8 nodes around."""

    nearest: Array[X, Y, Z]
    """int32, the number of the filled cell nearest to each node; size 0 where there is no cloud at all"""
    first: Array[M]
    """int32, where the points of each cell begin, filled or not, and where the last ends"""
    points: Floats[N, D3]
    """the cloud in the box by cells, world [m]"""
    low: Floats[D3]
    """the first node, world [m]"""
    spacing: float
    """[m]"""

    @property
    def is_empty(self) -> bool:
        return self.nearest.size == 0

    def at_nodes(self) -> Array[X, Y, Z]:
        """Return the distance of each node, float32 [m]."""
        shape = self.nearest.shape
        along = (low + self.spacing * np.arange(n) for low, n in zip(self.low, shape, strict=True))
        nodes = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1)
        return self.at(nodes.reshape(-1, 3))[0].reshape(shape).astype(np.float32)

    def at(self, points: Floats[N, D3]) -> tuple[Floats[N], Floats[N, D3]]:
        """Return distance [m] and its gradient at points world; zeros without a cloud."""
        points = np.ascontiguousarray(points, dtype=float)
        check_shape(points, (None, 3), "points")
        distance, gradient = np.zeros(len(points)), np.zeros(points.shape)
        if not self.is_empty:
            look_up(self, points, 0.0, distance, gradient)
        return distance, gradient


def distance_map(
    points: Floats[N, D3],
    low: Floats[D3],
    high: Floats[D3],
    spacing_m: float = SPACING_M,
    most_voxels: int = MOST_VOXELS,
) -> DistanceMap:
    """Return the distance map of points in the box low, high, world [m]. 2004 paper, section 4.

    Points outside the box and points that are not finite are left out.
    """
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    if not (np.isfinite([low, high]).all() and (high > low).all() and spacing_m > 0):
        raise HandtrackError(
            f"distance map: box from {low} to {high} m, spacing {spacing_m:g} m; expected positive lengths."
        )
    spacing = max(spacing_m, float(np.prod(high - low) / most_voxels) ** (1 / 3))
    while np.prod(np.ceil((high - low) / spacing) + 1.0) > most_voxels:
        spacing *= 1.02
    x, y, z = np.ceil((high - low) / spacing).astype(int) + 1
    shape = int(x), int(y), int(z)
    points = np.asarray(points, dtype=float)
    check_shape(points, (None, 3), "cloud")
    with np.errstate(invalid="ignore"):
        inside = ((points >= low) & (points <= high)).all(axis=1)  # False for NaN
    points, found = np.ascontiguousarray(points[inside]), shape if inside.any() else (0, 0, 0)
    cells, nearest = np.empty(found, np.int32), np.empty(found, np.int32)
    ordered, first = fill_cells(points, low, spacing, cells)
    if len(points):
        fill_nearest(cells, nearest)
    return DistanceMap(nearest, first, ordered, low, float(spacing))
