"""Ground truth from whatever it was measured with: a hand's or a body's joints by their names, in metres."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, F, Floats, Ints, N, indices
from handtrack.capture.images.openpose import LAYOUTS
from handtrack.capture.joints.given_joints import named_points
from handtrack.capture.joints.joint_names import JOINTS, NAMED, named_bodies
from handtrack.errors import HandtrackError
from handtrack.files.text_files import (
    UNITS_M,
    check_file,
    column_of,
    first_bytes,
    metres_in,
    number_in,
    read_rows,
    read_text,
)
from handtrack.observation.truth import Truth
from handtrack.session.formats.truth import read_truth

_HAND_M = (
    0.06,
    0.25,
)  # between the two points furthest apart: a small child's fist to a large man's flat hand
_BODY_M = (0.5, 3.0)  # likewise: of a crouching child to a tall man with raised arms
_BODY = tuple(LAYOUTS[NAMED].points)
_LIKELY_M = (
    1.0,
    0.01,
    0.001,
)  # each ten times the next, and a hand's range is four: at most one fits


def import_truth(path: Path, side: str) -> tuple[Truth, str]:
    """Return the truth of truth.npz, TRC, C3D or CSV, and what was left out, in a sentence or none.

    Parameters
    ----------
    side
        Of the hand, where the file has both.

    Raises
    ------
    HandtrackError
        Where the unit cannot be known, or no hand is in it.
    """
    if path.is_file() and first_bytes(path)[:4] == b"PK\3\4":
        return read_truth(path), ""
    markers = read_markers(path)
    try:
        sides, unknown = named_points(markers.names, str(path))
    except HandtrackError:
        rows = named_bodies(markers.names)
        if rows is None:
            raise
        sides = {"": {i: _BODY[row] for i, row in rows.items()}}
        unknown = tuple(name for i, name in enumerate(markers.names) if i not in rows)
    chosen = sides.get(side) or (
        next(iter(sides.values())) if len(sides) == 1 and "" in sides else {}
    )
    spans = _HAND_M if set(chosen.values()) <= set(JOINTS) else _BODY_M
    if not chosen:
        raise HandtrackError(
            f"{path}: no {side} hand; there is a {' and a '.join(filter(None, sides))} one. Choose one with --side."
        )
    finite = np.isfinite(markers.positions[:, list(chosen)])
    known = np.asarray(finite.all(axis=2))
    columns = [
        column for column, there in zip(chosen, np.asarray(known.any(axis=0)), strict=True) if there
    ]
    rows = np.asarray(known.any(axis=1))
    if not columns:
        raise HandtrackError(f"{path}: no frame has a point of the hand.")
    positions = markers.positions[rows][:, columns]
    positions[np.isnan(positions).any(axis=2)] = np.nan
    positions *= _unit(markers, positions, path, spans)
    names = tuple(chosen[c] for c in columns)
    missing = [chosen[c] for c in chosen if c not in columns]
    gaps = int(np.isnan(positions[..., 0]).sum())
    notes = [f"{gaps} of {positions[..., 0].size} points are not known"] if gaps else []
    notes += [f"{int((~rows).sum())} frames without any are left out"] if not rows.all() else []
    notes += [f"left out: {', '.join((*missing, *unknown)[:8])}"] if missing or unknown else []
    ordered = positions[:, indices(names, JOINTS)] if set(names) == set(JOINTS) else None
    times = None if markers.times_s is None else markers.times_s[rows]
    truth = Truth(markers.frames[rows], times, ordered, names, positions)
    return truth, f"{path}: {'; '.join(notes)}." if notes else ""


def _unit(
    markers: Markers, positions: Floats[F, N, D3], path: Path, spans: tuple[float, float]
) -> float:
    """Return metres in one unit: what the file says, else what makes a hand, or a body, of its points."""
    if markers.unit_m is not None:
        return markers.unit_m
    count = np.isfinite(positions[..., 0]).sum(axis=1)
    fullest = positions[count == count.max()]  # frames with gaps span less
    span = np.nanmax(fullest, axis=1) - np.nanmin(fullest, axis=1)
    size = float(np.median(np.linalg.norm(span, axis=1)))
    fits = [unit for unit in _LIKELY_M if spans[0] <= size * unit <= spans[1]]
    if len(fits) != 1:
        raise HandtrackError(
            f"{path}: its points span {size:.3g}, which is no hand or body in metres, centimetres or millimetres. Write the unit in the "
            "names of the columns, such as wrist_x_mm."
        )
    return fits[0]


# ---- Points in space by name as motion capture writes them: TRC, C3D (by the optional c3d), CSV


_WHAT = "points in space"
_LARGEST = 1 << 29
_MOST_MARKERS = 2000
_COLUMN = re.compile(r"(.+?)[_. ]?([xyz])(?:[_. ]?(m|mm|cm))?", re.IGNORECASE)
ACCEPTED = "truth.npz, TRC, C3D, or a CSV with the columns frame and <point>_x, _y, _z (or frame, joint, x, y, z)"


@dataclass(frozen=True)
class Markers:
    """Points by frame, in the file's unit."""

    names: tuple[str, ...]
    frames: Ints[F]
    """from 0."""
    times_s: Floats[F] | None
    positions: Floats[F, N, D3]
    """NaN where a point is missing."""
    unit_m: float | None
    """metres in one unit, where the file says it."""


def read_markers(path: Path) -> Markers:
    """Return the points of a file, told by its content. Raises HandtrackError naming what is accepted."""
    check_file(path, _WHAT, _LARGEST)
    start = first_bytes(path)
    if start[1:2] == b"\x50" and start[:1] != b"P":  # the block of parameters, and C3D's mark
        return _c3d(path)
    if b"\0" in start or not start.strip():
        raise _unknown(path)
    text = read_text(path, _WHAT, _LARGEST)
    rows = read_rows(text, str(path), "\t" if text.startswith("PathFileType") else "")
    if text.startswith("PathFileType"):
        return _trc(rows, path)
    rows = [row for row in rows if any(row)]
    if not rows:
        raise _unknown(path)
    head = [name.strip().lower() for name in rows[0]]
    return _long(rows, head, path) if {"x", "y", "z"} <= set(head) else _wide(rows, head, path)


def _trc(rows: list[list[str]], path: Path) -> Markers:
    if len(rows) < 6:
        raise HandtrackError(f"{path}: a TRC file without rows of points.")
    about = {
        key.strip().lower(): value.strip() for key, value in zip(rows[1], rows[2], strict=False)
    }
    unit_m = metres_in(about.get("units", ""), f"{path}: Units")
    names = tuple(name.strip() for name in rows[3][2:] if name.strip())
    body = [row for row in rows[5:] if any(cell.strip() for cell in row)]
    places = [[2 + 3 * i + k for k in range(3)] for i in range(len(names))]
    return _markers(
        names,
        [row[0] for row in body],
        [row[1] if len(row) > 1 else "" for row in body],
        _numbers(body, places, path),
        unit_m,
        path,
    )


def _wide(rows: list[list[str]], head: list[str], path: Path) -> Markers:
    places: dict[str, dict[str, int]] = {}
    units = set[str]()
    for i, name in enumerate(rows[0]):
        match = _COLUMN.fullmatch(name.strip())
        if match:
            places.setdefault(match[1], {})[match[2].lower()] = i
            units |= {match[3].lower()} if match[3] else set()
    names = tuple(name for name, axes in places.items() if len(axes) == 3)
    if not names or len(units) > 1:
        raise _unknown(path)
    at_frame, at_time = column_of(head, "frame frame#"), column_of(head, "time_s time t")
    body = rows[1:]
    frames = [str(i) if at_frame is None else _cell(row, at_frame) for i, row in enumerate(body)]
    times = [] if at_time is None else [_cell(row, at_time) for row in body]
    numbers = _numbers(body, [[places[n][axis] for axis in "xyz"] for n in names], path)
    unit = UNITS_M[next(iter(units))] if units else None
    return _markers(names, frames, times, numbers, unit, path, counted=True)


def _long(rows: list[list[str]], head: list[str], path: Path) -> Markers:
    at_name, at_frame = (
        column_of(head, "joint point marker name landmark"),
        column_of(head, "frame"),
    )
    if at_name is None or at_frame is None:
        raise _unknown(path)
    axes = [head.index(axis) for axis in "xyz"]
    body = rows[1:]
    names = tuple(dict.fromkeys(_cell(row, at_name) for row in body))
    frames = list(dict.fromkeys(_cell(row, at_frame) for row in body))
    if len(names) > _MOST_MARKERS:
        raise HandtrackError(f"{path}: {len(names)} different points; expected those of a hand.")
    values = _numbers(body, [axes], path)[:, 0]
    positions = np.full((len(frames), len(names), 3), np.nan)
    by_frame, by_name = ({key: i for i, key in enumerate(keys)} for keys in (frames, names))
    for row, value in zip(body, values, strict=True):
        positions[by_frame[_cell(row, at_frame)], by_name[_cell(row, at_name)]] = value
    return _markers(names, frames, [], positions, None, path, counted=True)


def _c3d(path: Path) -> Markers:
    try:
        import c3d  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise HandtrackError(
            f"{path} is C3D, which needs c3d: pip install handtrack3d[c3d], or export TRC or CSV."
        ) from None
    try:
        with path.open("rb") as file:
            reader = c3d.Reader(file)
            count = reader.last_frame - reader.first_frame + 1
            if (
                count * reader.point_used * 16 > 40 * path.stat().st_size
            ):  # a point takes 8 or 16 bytes
                raise HandtrackError(
                    f"{path}: announces {count} frames of {reader.point_used} points, more than it can hold."
                )
            names = tuple(label.strip() for label in reader.point_labels[: reader.point_used])
            units = reader.get("POINT:UNITS")
            unit = str(units.string_value) if units is not None else "mm"
            read = [(number, points) for number, points, _ in reader.read_frames(copy=True)]
            rate = float(reader.point_rate)
    except HandtrackError:
        raise
    except Exception as error:  # the library fails in many ways on damaged bytes
        raise HandtrackError(
            f"{path}: not readable as C3D ({str(error)[:80] or type(error).__name__})."
        ) from None
    if not read:
        raise HandtrackError(f"{path}: no frames in it.")
    unit_m = metres_in(unit, f"{path}: POINT:UNITS")
    frames = np.array([number - 1 for number, _ in read])  # C3D counts from 1
    points = np.array([rows[: len(names), :5] for _, rows in read], dtype=float)
    positions = np.where((points[..., 3] < 0)[..., None], np.nan, points[..., :3])
    return Markers(names, frames, frames / rate if rate > 0 else None, positions, unit_m)


def _markers(
    names: tuple[str, ...],
    frames: list[str],
    times: list[str],
    positions: Floats[F, N, D3],
    unit_m: float | None,
    path: Path,
    counted: bool = False,
) -> Markers:
    """counted: frames are counted from 0; else from 1, unless there is a 0."""
    numbers = [number_in(text, str(path)) for text in frames]
    if (
        not numbers
        or not all(0 <= n < 1e7 and n == int(n) for n in numbers)
        or len(set(numbers)) < len(numbers)
    ):
        raise HandtrackError(
            f"{path}: expected frames with whole numbers, each once, and at least one."
        )
    first = 0 if counted or 0 in numbers else 1
    said = [number_in(text, str(path)) for text in times]
    times_s = np.array(said) if said and np.isfinite(said).all() else None
    return Markers(names, np.array(numbers, dtype=int) - first, times_s, positions, unit_m)


def _numbers(rows: list[list[str]], places: list[list[int]], path: Path) -> Floats[F, N, D3]:
    if len(places) > _MOST_MARKERS:
        raise HandtrackError(f"{path}: {len(places)} points; expected those of a hand.")
    values = [
        [[number_in(_cell(row, at), str(path)) for at in three] for three in places] for row in rows
    ]
    return np.array(values, dtype=float).reshape(len(rows), len(places), 3)


def _cell(row: list[str], at: int) -> str:
    return row[at] if at < len(row) else ""


def _unknown(path: Path) -> HandtrackError:
    return HandtrackError(f"{path}: no points in space that are known here. Accepted: {ACCEPTED}.")
