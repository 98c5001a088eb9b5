"""PointCloud: measured points with colours, as frozen data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import D3, Array, Axes, Floats, N, array_dataclass, check_shape


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
