"""Read point clouds from .ply and .npz files in metres, leaving out unusable points with a note.

PLY has an own reader, since trimesh reads a file whole and several times over: here a file of ten million
points costs no more memory than the part of it that is kept.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, Array, Floats, M, N
from handtrack.capture.clouds.cloud_filters import finite
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.errors import HandtrackError
from handtrack.files.npz_files import read_arrays
from handtrack.files.text_files import first_bytes

SUFFIXES = (".ply", ".npz")
MOST_POINTS = 1_000_000  # read from one file: bounds memory and time; a hand needs thousands
_LARGE_M = 20.0  # no camera sees a hand in a cloud of that extent


def read_cloud(path: Path, world_unit_m: float = 1.0) -> tuple[PointCloud, tuple[str, ...]]:
    """Return the cloud of a .ply or .npz file (`points` (N, 3), optional `colors` (N, 3)), and what
    was odd about it, in sentences.

    Points that are not finite are dropped; of more than a million an even part is kept; an extent
    above 20 m is asked about.

    Parameters
    ----------
    world_unit_m
        Metres in one unit of the file.

    Raises
    ------
    HandtrackError
        For a file that cannot be read.
    """
    reader = _read_npz if _suffix(path) == ".npz" else read_ply
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
    return cloud, tuple(warnings)


def write_cloud(path: Path, cloud: PointCloud, world_unit_m: float = 1.0) -> None:
    """Write a cloud as .ply or .npz in units of world_unit_m [m]. Raises HandtrackError for another
    suffix."""
    points = cloud.points / world_unit_m
    if _suffix(path) == ".ply":
        import trimesh  # slow to import, and most only read
        from trimesh.exchange.ply import export_ply

        colors = cloud.colors if len(points) else np.zeros((0, 3), np.uint8)  # trimesh wants them
        path.write_bytes(export_ply(trimesh.PointCloud(points, colors)))
    else:
        arrays: dict[str, Any] = {"points": points.astype(np.float32), "colors": cloud.colors}
        np.savez_compressed(path, **{k: array for k, array in arrays.items() if array is not None})


def _suffix(path: Path) -> str:
    if path.suffix.lower() not in SUFFIXES:
        raise HandtrackError(f"{path}: neither .ply nor .npz.")
    return path.suffix.lower()


def _extent_warning(path: Path, points: Floats, world_unit_m: float) -> Iterator[str]:
    if len(points) < 2:
        return
    # quantiles: one stray point says nothing about the unit
    low, high = np.quantile(points, [0.05, 0.95], axis=0)
    extent = float((high - low).max())
    if extent <= _LARGE_M:
        return
    hint = ""
    if world_unit_m == 1.0:
        hint = (
            " Are they millimetres? Then set world_unit_m = 0.001 in [session], if calibration.toml is in "
            "millimetres too; if that is in metres, write the clouds in metres."
        )
    yield (
        f"{path}: the points are spread over {extent:.0f} m, with world_unit_m = {world_unit_m:g}; "
        f"a hand before a camera fills less than a metre.{hint}"
    )


def _read_npz(path: Path, most: int) -> tuple[Floats, Array | None, int]:
    arrays = read_arrays(path)
    points, colors = arrays.get("points"), arrays.get("colors")
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


# ---- Read and write point clouds as .ply: ascii and binary in, binary little endian out


_TYPES = {
    word: kind
    for kind, words in {
        "i1": "char int8",
        "u1": "uchar uint8",
        "i2": "short int16",
        "u2": "ushort uint16",
        "i4": "int int32",
        "u4": "uint uint32",
        "f4": "float float32",
        "f8": "double float64",
    }.items()
    for word in words.split()
}
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_COLOURS = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
)
_LONGEST_HEADER = 64 * 1024


def read_ply(path: Path, most: int) -> tuple[Floats[N, D3], Array[N, D3] | None, int]:
    """Return points, colours uint8 RGB or None, and how many points the file has.

    Of more than `most` points, about that many are returned, evenly spread. Raises HandtrackError
    for what is no .ply, is cut off, or has no vertices with x, y, z.
    """
    order, count, fields, start = _header(path)
    names = [name for name, _ in fields]
    if not {"x", "y", "z"} <= set(names):
        raise HandtrackError(
            f"{path}: the vertices have no x, y, z; properties there: {', '.join(names) or 'none'}."
        )
    if len(set(names)) < len(names):
        raise HandtrackError(f"{path}: a vertex property is named twice: {', '.join(names)}.")
    if count == 0:
        return np.zeros((0, 3)), None, 0
    if count > path.stat().st_size:  # do not believe any header
        raise _cut_off(path, count, "fewer")
    kind = np.dtype([(name, order + kind) for name, kind in fields])
    picked = spread_part(count, most)
    if order:
        found = max(path.stat().st_size - start, 0) // kind.itemsize
        if found < count:
            raise _cut_off(path, count, found)
        table = np.array(np.memmap(path, kind, "r", offset=start, shape=(count,))[picked])
    else:
        table = _ascii(path, kind, count, start, picked)
    points = np.column_stack([table[axis] for axis in "xyz"]).astype(float)
    triple = next((triple for triple in _COLOURS if set(triple) <= set(names)), None)
    colors = triple and _eight_bit(np.column_stack([table[name] for name in triple]))
    return points, colors, count


def spread_part(count: int, most: int) -> Array[M]:
    """Return ascending indices of at most `most` of `count` things: one, at random, of each of
    `most` stretches of equal length; all where they are few. A fixed pattern, part of reading a
    file: no seed changes it."""
    if count <= most:
        return np.arange(count)
    edges = np.linspace(0, count, most + 1)
    inside = np.random.default_rng(0).random(most)
    return (edges[:-1] + inside * np.diff(edges)).astype(np.int64)


def _header(path: Path) -> tuple[str, int, list[tuple[str, str]], int]:
    """Return numpy's sign for the byte order, empty for ascii; how many vertices there are; their properties; the first byte after the header."""
    head = first_bytes(path, _LONGEST_HEADER)
    end = head.find(b"end_header")
    if not head.startswith(b"ply") or end < 0:
        raise HandtrackError(
            f"{path}: not a .ply file; it has no header from `ply` to `end_header`."
        )
    start = head.find(b"\n", end) + 1 or len(head)
    order: str | None = None
    count, fields, elements = -1, [], []
    for line in head[:end].decode("ascii", errors="replace").splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            order = _FORMATS.get(words[1] if len(words) > 1 else "")
        elif words[:1] == ["element"] and len(words) == 3 and words[2].isdecimal():
            elements.append(words[1])
            if words[1] == "vertex":
                count = int(words[2])
        elif words[:1] == ["property"] and elements[-1:] == ["vertex"]:
            if len(words) != 3 or words[1] not in _TYPES:
                raise HandtrackError(f"{path}: the vertex property `{line}` cannot be read.")
            fields.append((words[2], _TYPES[words[1]]))
    if order is None:
        raise HandtrackError(f"{path}: no known format; expected one of {', '.join(_FORMATS)}.")
    if elements[:1] != ["vertex"]:
        raise HandtrackError(
            f"{path}: expected the vertices first; elements there: {', '.join(elements) or 'none'}."
        )
    return order, count, fields, start


def _ascii(path: Path, kind: np.dtype, count: int, start: int, picked: Array) -> Array:
    wanted = np.zeros(count, bool)
    wanted[picked] = True
    rows: list[str] = []
    with path.open("rb") as file:
        file.seek(start)
        seen = 0
        for seen, line in enumerate(islice(file, count), 1):
            if wanted[seen - 1]:
                rows.append(line.decode("ascii", errors="replace"))
    if seen < count:
        raise _cut_off(path, count, seen)
    try:
        numbers = np.loadtxt(rows, dtype=float, ndmin=2, usecols=range(len(kind.names or ())))
    except ValueError as error:
        raise HandtrackError(
            f"{path}: the points cannot be read: {str(error).rstrip('.')}. Expected numbers with spaces between them."
        ) from None
    table = np.empty(len(numbers), kind)
    for name, column in zip(kind.names or (), numbers.T, strict=True):
        if kind[name].kind in "iu":
            limits = np.iinfo(kind[name])
            column = np.clip(np.nan_to_num(column), limits.min, limits.max)
        table[name] = column
    return table


def _cut_off(path: Path, announced: int, found: int | str) -> HandtrackError:
    return HandtrackError(
        f"{path}: announces {announced} points, but holds {found}; the file is cut off. Write it "
        "again."
    )
