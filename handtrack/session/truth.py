"""truth.npz: what a recording really shows, where that is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, F, Floats, N, indices
from handtrack.capture.images.openpose import LAYOUTS
from handtrack.capture.joints.given_joints import JOINTS, NAMED, named_bodies, named_points
from handtrack.capture.joints.table_joints import IN_SPACE, PointTable, read_points
from handtrack.errors import HandtrackError
from handtrack.files.npz_files import read_arrays
from handtrack.files.text_files import check_file, first_bytes, metres_in, read_rows, read_text
from handtrack.observation.truth import Truth
from handtrack.session.tables import checked_arrays, write_arrays

_KNOWN: dict[str, tuple[type, tuple[str | int, ...]]] = {
    "keypoints21": (float, ("F", 21, 3)),
    "joint_positions": (float, ("F", "J", 3)),
    "joint_names": (str, ("J",)),
    "frame": (int, ("F",)),
    "time_s": (float, ("F",)),
}


def read_truth(path: Path) -> Truth:
    """Return the ground truth of a file. Raises HandtrackError naming the array that is wrong."""
    given = read_arrays(path)
    points = [name for name in ("keypoints21", "joint_positions") if name in given]
    if not points:
        raise HandtrackError(
            f"{path}: no keypoints21 and no joint_positions; expected at least one. Found: "
            f"{', '.join(given) or 'nothing'}."
        )
    if "joint_positions" in points and "joint_names" not in given:
        raise HandtrackError(
            f"{path}: joint_positions without joint_names; expected a name for each of the joints."
        )
    arrays = checked_arrays(path, given, _KNOWN)
    for name in points:
        if np.isinf(arrays[name]).any():
            row = int(np.flatnonzero(np.isinf(arrays[name]).any(axis=(1, 2)))[0])
            raise HandtrackError(
                f"{path}: {name} has infinite values, first in row {row}; expected metres, and NaN where a point is not known."
            )
        arrays[name][np.isnan(arrays[name]).any(axis=2)] = np.nan
    frame, time_s = arrays.get("frame", np.arange(len(arrays[points[0]]))), arrays.get("time_s")
    if (frame < 0).any() or len(np.unique(frame)) < len(frame):
        raise HandtrackError(
            f"{path}: frame has negative or repeated numbers; expected each frame once."
        )
    if time_s is not None and not np.isfinite(time_s).all():
        raise HandtrackError(
            f"{path}: time_s has values that are no numbers; expected finite seconds."
        )
    names = tuple(map(str, arrays["joint_names"])) if "joint_positions" in points else ()
    told = given.get("keypoint_definition")
    return Truth(
        frame,
        time_s,
        arrays.get("keypoints21"),
        names,
        arrays.get("joint_positions"),
        None if told is None else str(told),
    )


def write_truth(path: Path, truth: Truth) -> None:
    """Write truth.npz, without what is not known, and without frame numbers where they count from 0."""
    known = {name: value for name, value in vars(truth).items() if value is not None and len(value)}
    if np.array_equal(truth.frame, np.arange(len(truth.frame))):
        del known["frame"]
    write_arrays(path, {name: np.asarray(value) for name, value in known.items()})


# ---- Truth from whatever it was measured with: a hand's or a body's joints by their names, in metres


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
    finite = np.isfinite(markers.values[:, list(chosen)])
    known = np.asarray(finite.all(axis=2))
    columns = [
        column for column, there in zip(chosen, np.asarray(known.any(axis=0)), strict=True) if there
    ]
    rows = np.asarray(known.any(axis=1))
    if not columns:
        raise HandtrackError(f"{path}: no frame has a point of the hand.")
    positions = markers.values[rows][:, columns]
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
    markers: PointTable, positions: Floats[F, N, D3], path: Path, spans: tuple[float, float]
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
ACCEPTED = "truth.npz, TRC, C3D, or a CSV with the columns frame and <point>_x, _y, _z (or frame, joint, x, y, z)"


def read_markers(path: Path) -> PointTable:
    """Return the points of a file, told by its content. Raises HandtrackError naming what is accepted."""
    check_file(path, _WHAT, _LARGEST)
    start = first_bytes(path)
    if start[1:2] == b"\x50" and start[:1] != b"P":  # the block of parameters, and C3D's mark
        return _c3d(path)
    table = None
    if b"\0" not in start and start.strip():
        text = read_text(path, _WHAT, _LARGEST)
        is_trc = text.startswith("PathFileType")
        rows = read_rows(text, str(path), "\t" if is_trc else "")
        rows = [row for row in rows if any(cell.strip() for cell in row)]
        table = _trc(rows, path) if is_trc else read_points(rows or [[]], str(path), IN_SPACE)
    if table is None or not len(table.frames):
        raise HandtrackError(
            f"{path}: no points in space that are known here. Accepted: {ACCEPTED}."
        )
    return table


def _trc(rows: list[list[str]], path: Path) -> PointTable | None:
    """Return the points of a TRC: its frames are counted from 1, unless there is a 0."""
    if len(rows) < 6:
        raise HandtrackError(f"{path}: a TRC file without rows of points.")
    about = {key.strip().lower(): value.strip() for key, value in zip(rows[1], rows[2])}
    unit_m = metres_in(about.get("units", ""), f"{path}: Units")
    names = [name.strip() for name in rows[3][2:] if name.strip()]
    head = ["frame", "time", *(f"{name}_{axis}" for name in names for axis in "xyz")]
    table = read_points([head, *rows[5:]], str(path), IN_SPACE)
    first = int(table is not None and 0 not in table.frames)
    return table and replace(table, frames=table.frames - first, unit_m=unit_m)


def _c3d(path: Path) -> PointTable:
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
    return PointTable(names, frames, positions, frames / rate if rate > 0 else None, unit_m)
