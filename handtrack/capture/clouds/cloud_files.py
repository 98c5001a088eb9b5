"""Read point clouds from .ply and .npz files in metres, leaving out unusable points with a note."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handtrack.arrays import Array, Floats
from handtrack.capture.clouds.cloud_filters import finite
from handtrack.capture.clouds.ply import read_ply, spread_part, write_ply
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.errors import HandtrackError
from handtrack.files.npz_files import read_arrays

SUFFIXES = (".ply", ".npz")
MOST_POINTS = 1_000_000  # read from one file: bounds memory and time; a hand needs thousands
_LARGE_M = 20.0  # no camera sees a hand in a cloud of that extent
_POINTS = "points"


@dataclass(frozen=True, eq=False)
class ReadCloud:
    """A cloud as read, and what was odd about its file."""

    cloud: PointCloud
    warnings: tuple[str, ...]
    """plain sentences; each names the file."""


def read_cloud(path: Path, world_unit_m: float = 1.0) -> ReadCloud:
    """Return the cloud of a .ply or .npz file (`points` (N, 3), optional `colors` (N, 3)).

    world_unit_m: metres in one unit of the file. Points that are not finite are dropped; of more
    than a million an even part is kept; an extent above 20 m is asked about. Raises
    HandtrackError for a file that cannot be read.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise HandtrackError(f"{path}: neither .ply nor .npz.")
    reader = _read_npz if path.suffix.lower() == ".npz" else read_ply
    points, colors, count = reader(path, MOST_POINTS)
    warnings = []
    if len(points) < count:
        warnings.append(
            f"{path}: {count} points; an even part of {len(points)} is used. Thin the clouds when "
            "writing them: a hand needs a few thousand."
        )
    good = finite(points)
    if not good.all():
        warnings.append(
            f"{path}: {int((~good).sum())} of {len(points)} points are not finite numbers and are "
            "left out."
        )
    cloud = PointCloud(points * world_unit_m, colors).select(good)
    warnings += _extent_warning(path, cloud.points, world_unit_m)
    return ReadCloud(cloud, tuple(warnings))


def write_cloud(path: Path, cloud: PointCloud, world_unit_m: float = 1.0) -> None:
    """Write a cloud as .ply or .npz in units of world_unit_m [m]. Raises HandtrackError for another
    suffix."""
    path = Path(path)
    points = cloud.points / world_unit_m
    if path.suffix.lower() == ".ply":
        write_ply(path, points, cloud.colors)
    elif path.suffix.lower() == ".npz":
        single = points.astype(np.float32)
        if cloud.colors is None:
            np.savez_compressed(path, points=single)
        else:
            np.savez_compressed(path, points=single, colors=cloud.colors)
    else:
        raise HandtrackError(f"{path}: neither .ply nor .npz.")


def _extent_warning(path: Path, points: Floats, world_unit_m: float) -> list[str]:
    if len(points) < 2:
        return []
    # quantiles: one stray point says nothing about the unit
    low, high = np.quantile(points, [0.05, 0.95], axis=0)
    extent = float((high - low).max())
    if extent <= _LARGE_M:
        return []
    hint = ""
    if world_unit_m == 1.0:
        hint = (
            " Are they millimetres? Then set world_unit_m = 0.001 in [session], if calibration.toml is in "
            "millimetres too; if that is in metres, write the clouds in metres."
        )
    return [
        f"{path}: the points are spread over {extent:.0f} m, with world_unit_m = {world_unit_m:g}; "
        f"a hand before a camera fills less than a metre.{hint}"
    ]


def _read_npz(path: Path, most: int) -> tuple[Floats, Array | None, int]:
    arrays = read_arrays(path)
    points, colors = arrays.get(_POINTS), arrays.get("colors")
    if points is None:
        raise HandtrackError(
            f"{path}: no array `points`; arrays there: {', '.join(arrays) or 'none'}."
        )
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise HandtrackError(
            f"{path}: `points` has the shape {points.shape} of {points.dtype}; expected (N, 3) numbers."
        )
    if colors is not None and (colors.shape != points.shape or colors.dtype.kind not in "fiu"):
        raise HandtrackError(
            f"{path}: `colors` has the shape {colors.shape} of {colors.dtype}; expected numbers of the shape of `points`, "
            f"{points.shape}."
        )
    picked = spread_part(len(points), most)
    if colors is not None:
        colors = _eight_bit(colors[picked])
    return points[picked].astype(float), colors, len(points)


def _eight_bit(colors: Array) -> Array:
    if colors.dtype == np.uint8:
        return colors
    if colors.dtype.kind == "f" and np.nanmax(colors, initial=0.0) <= 1.0:
        colors = colors * 255.0
    return np.clip(np.nan_to_num(colors), 0, 255).astype(np.uint8)
