"""Grid of distances to the cloud around the hand, made once a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, Array, Floats, N, X, Y, Z, check_shape
from handtrack.errors import HandtrackError
from handtrack.terms.clouds.distance_map_kernels import interpolate
from handtrack.terms.clouds.nearest_cells_kernels import fill_cells, fill_distances

SPACING_M = 0.004
MOST_VOXELS = 8_000_000
"""The grid gets coarser rather than larger; about 150 MB are in use while this many are computed."""


@dataclass(frozen=True, eq=False)
class DistanceMap:
    """Unsigned distances to a cloud on a grid, trilinear between its nodes.

    Beyond the grid: the value at the nearest place on its border plus the way there.
    """

    low: Floats[D3]
    """the first node, world [m]"""
    spacing: float
    """[m]"""
    values: Array[X, Y, Z]
    """float32 [m]; size 0 where there is no cloud at all"""

    @property
    def is_empty(self) -> bool:
        return self.values.size == 0

    def at(self, points: Floats[N, D3]) -> tuple[Floats[N], Floats[N, D3]]:
        """Return distance [m] and its gradient at points world; zeros without a cloud."""
        points = np.ascontiguousarray(points, dtype=float)
        check_shape(points, (None, 3), "points")
        distance, gradient = np.zeros(len(points)), np.zeros(points.shape)
        if not self.is_empty:
            interpolate(self.values, self.low, self.spacing, points, distance, gradient)
        return distance, gradient


def distance_map(
    points: Floats[N, D3],
    low: Floats[D3],
    high: Floats[D3],
    spacing_m: float = SPACING_M,
    most_voxels: int = MOST_VOXELS,
) -> DistanceMap:
    """Return the distance map of points in the box low, high, world [m]. 2004 paper, section 4.

    The nearest filled voxel is found exactly; the distance is that to the mean of the points
    in it, so that voxels do not round it. Points outside the box and points that are not finite are left out.
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
    points = points[inside]
    if not len(points):
        return DistanceMap(low, spacing, np.zeros((0, 0, 0), np.float32))
    place, values = np.empty(shape, np.int32), np.empty(shape, np.float32)
    mean = fill_cells(np.ascontiguousarray(points), low, spacing, place)
    fill_distances(mean, place, low, spacing, values)
    return DistanceMap(low, spacing, values)
