"""Tables and arrays. CSV files: a row a frame (contracts §5), tidy tables, Anipose's table of points; and the JSON beside them that says what columns mean."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from handtrack.arrays import Array
from handtrack.errors import HandtrackError
from handtrack.export.isb import isb_angles, isb_std
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import check_folder_of, keep_version, replace_text, replacing
from handtrack.geometry.rotation import quaternion_wxyz
from handtrack.model.articulated import keypoint_names
from handtrack.session.tables import AXES, anatomy_arrays, write_arrays, write_npz
from handtrack.tracking.frame.result import (
    Status,
    TrackResult,
    frame_columns,
    is_length,
    joint_confidence,
    labelled,
)

if TYPE_CHECKING:
    from scipy.io import netcdf_file

_BEGINS_A_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def number(value: float | np.floating) -> str:
    """Return a number with nine digits; nothing for one that is not known."""
    return "" if np.isnan(value) else f"{float(value):.9g}"


def beside(path: Path) -> Path:
    """Return the path of a file that nobody asked for by its name; what stands there is kept in versions/."""
    keep_version(path)
    return path


def write_rows(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> Path:
    """Write a CSV file whole or not at all; return its path."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([_harmless(cell) for cell in header])
    for row in rows:
        writer.writerow([_harmless(cell) for cell in row])
    replace_text(path, text.getvalue())
    return path


def _harmless(cell: object) -> object:
    """Return a cell that no spreadsheet takes for a formula: names come from files that others made; numbers stay."""
    if not isinstance(cell, str) or not cell.startswith(_BEGINS_A_FORMULA):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


# ---- The JSON file beside a CSV: what its columns mean, and all that a table of numbers cannot hold


def write_sidecar(path: Path, table: ResultsTable, columns: dict[str, str]) -> Path:
    """Write the file that explains `path`, beside it with the suffix .json; return its path. columns: meaning by name."""
    side = beside(path.with_suffix(".json"))
    replace_text(side, json.dumps(about(table) | {"columns": columns}, indent=1) + "\n")
    return side


def about(table: ResultsTable) -> dict[str, Any]:
    """Return what is known of a sequence beside its frames, as JSON has it: numbers in metres and degrees, unknown ones null."""
    track = table.track
    return {
        "session": track.session,
        "model": track.model,
        "side": track.side,
        "person": _read(track.scale),
        "hand_length_mm": track.hand_length_mm,
        "hand_length_std_mm": track.hand_length_std_mm,
        "frames": [int(track.frame[0]), int(track.frame[-1])],
        "fps": table.fps,
        "unit": "m",
        "axes": AXES,
        "status": {str(int(status)): status.name.lower() for status in Status},
        "joints": list(track.joint_names),
        "keypoint_definition": table.keypoint_definition,
        "parameters": _parameters(table),
        **_bones(table),
        "cameras": _read(track.cameras),
        "pins": _read(track.pins),
        "refinement": _read(track.refinement),
        "settings": _read(track.settings),
        "handtrack": track.version,
    }


def _parameters(table: ResultsTable) -> list[dict[str, Any]]:
    names = table.track.parameter_names
    try:
        limits = table.model.limits.interval
    except HandtrackError:  # of a program that does not say how its model is built
        limits = np.full((len(names), 2), np.inf)
    return [
        {
            "name": name,
            "unit": "m" if is_length(name) else "deg",
            "limits": None
            if not np.isfinite(interval).all()
            else (interval if is_length(name) else np.rad2deg(interval)).tolist(),
        }
        for name, interval in zip(names, limits, strict=True)
    ]


def _bones(table: ResultsTable) -> dict[str, Any]:
    names = table.track.bone_names
    try:
        built = anatomy_arrays(table.model)
    except HandtrackError:
        return {"bones": [{"name": name} for name in names]}
    return {
        "bones": [
            {
                "name": name,
                "parent": None if parent < 0 else names[parent],
                "length_m": float(length),
                "rest_T_bone": rest.tolist(),
            }
            for name, parent, length, rest in zip(
                names, built["parents"], built["bone_length"], built["rest_T_bone"], strict=True
            )
        ]
    }


def _read(text: str | None) -> Any:
    """Return what a JSON text says; the text itself where another program wrote none."""
    try:
        return None if not text else json.loads(text)
    except ValueError:
        return text


# ---- A row a frame: angles in degrees, lengths in metres, joints in the world


def write_wide(path: Path, table: ResultsTable) -> list[Path]:
    """Write the table and, beside it, what it means (.json)."""
    write_csv(path, table.track)
    meanings = {name: meaning for name, _, meaning in frame_columns(table.track)}
    return [write_sidecar(path, table, meanings)]


def write_csv(path: Path | str, track: TrackResult) -> None:
    """Write the columns of contracts §5; then what else is known of each frame, such as how probably it is off, and the reason.
    Raises HandtrackError where there is no such folder.
    """
    check_folder_of(path)
    names, columns, _ = zip(*frame_columns(track), strict=True)
    cells = (map(number if c.dtype.kind == "f" else str, c.tolist()) for c in columns)
    write_rows(Path(path), names, zip(*cells, strict=True))


# ---- Tidy: a row for each frame and joint; beside it one for each frame and angle, and one for each frame and bone


_FRAME = ["frame", "time_s", "status"]
_MEANINGS = {
    "joint": "name of a joint or fingertip; std: standard deviation along the world's axes",
    "angle": "in FILE_angles.csv; convention `handtrack`: docs/reference/results.md; `isb`: docs/reference/joint_angles.md",
    "bone": "in FILE_bones.csv; x y z: its proximal end in the world; quaternion w x y z: bone to world",
}


def write_long(path: Path, table: ResultsTable) -> list[Path]:
    """Write joints to `path`, angles to NAME_angles.csv, bones to NAME_bones.csv, what they mean to NAME.json."""
    track = table.track
    frames = [
        [int(f), number(t), int(s)] for f, t, s in zip(track.frame, track.time_s, track.status)
    ]
    header = [*_FRAME, "joint", "x_m", "y_m", "z_m", "std_x_m", "std_y_m", "std_z_m"]
    joints = (
        [*frames[i], name, *map(number, track.joint_positions[i, j]), *map(number, spread[j])]
        for i, spread in enumerate(table.joint_std)
        for j, name in enumerate(track.joint_names)
    )
    write_rows(path, header, joints)
    angles = [*_FRAME, "convention", "angle", "value_deg", "std_deg"]
    rows = ([*frames[i], *rest] for i, rest in _angles(table))
    angles_file = write_rows(beside(path.with_stem(f"{path.stem}_angles")), angles, rows)
    bones = [*_FRAME, "bone", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"]
    turns = quaternion_wxyz(track.T_world_bone[..., :3, :3])
    carried = (
        [*frames[i], name, *map(number, track.T_world_bone[i, b, :3, 3]), *map(number, turns[i, b])]
        for i in range(len(track))
        for b, name in enumerate(track.bone_names)
    )
    bones_file = write_rows(beside(path.with_stem(f"{path.stem}_bones")), bones, carried)
    return [angles_file, bones_file, write_sidecar(path, table, _MEANINGS)]


def _angles(table: ResultsTable) -> Iterator[tuple[int, list[str]]]:
    """Yield row of the frame; convention, name, value and standard deviation of each angle but the root's turn."""
    track = table.track
    own = [
        (s, name)
        for s, name in enumerate(track.parameter_names)
        if not is_length(name) and not name.startswith("root_r")
    ]
    values, spread = np.rad2deg(track.parameters), np.rad2deg(track.parameter_std)
    try:
        isb = isb_angles(table.model, track.T_world_bone)
        isb_spread = isb_std(table.model, track.parameters, track.parameter_std)
    except HandtrackError:  # of a program that does not say how its model is built
        isb, isb_spread = {}, {}
    for i in range(len(track)):
        for s, name in own:
            yield i, ["handtrack", name, number(values[i, s]), number(spread[i, s])]
        for name, angle in isb.items():
            std = np.rad2deg(isb_spread[name][i])
            yield i, ["isb", name, number(np.rad2deg(angle[i])), number(std)]


# ---- Anipose's table of 3D points: columns <joint>_x, _y, _z, _error, _ncams, _score [mm], a row a frame


_MM = 1e3


def write_anipose(path: Path, table: ResultsTable) -> None:
    """Write the table. `_score` is the confidence; `_error` [px] and `_ncams` are not known of a joint, which is no triangulated
    point: the first is empty, the second the session's number of cameras. Points of lost frames are empty.
    """
    track, cameras = table.track, 0 if table.rig is None else len(table.rig)
    header = [
        f"{joint}_{what}"
        for joint in track.joint_names
        for what in ("x", "y", "z", "error", "ncams", "score")
    ]
    header += [f"M_{i}{j}" for i in range(3) for j in range(3)]
    header += [f"center_{i}" for i in range(3)]
    places = np.where(table.is_lost[:, None, None], np.nan, _MM * track.joint_positions)
    turned = [*map(number, np.eye(3).ravel()), "0", "0", "0"]  # Anipose's own turn of the world
    rows = (
        [
            *(
                cell
                for place, sure in zip(points, score, strict=True)
                for cell in (*map(number, place), "", str(cameras), number(sure))
            ),
            *turned,
            int(frame),
        ]
        for frame, points, score in zip(
            track.frame, places, joint_confidence(table.track), strict=True
        )
    )
    write_rows(path, [*header, "fnum"], rows)


# ---- Arrays: poses.npz again, joint positions alone, and NetCDF (classic, by SciPy) as xarray, MATLAB and R read it


def write_result(path: Path, table: ResultsTable) -> None:
    """Write the result as it was read."""
    write_npz(path, table.track)


# ---- Joint positions alone, in the form of a session's truth.npz (contracts §2)


def write_keypoints(path: Path, table: ResultsTable) -> None:
    """Write joint positions by name, the 21 keypoints of hands, and whose points they are."""
    track = table.track
    arrays: dict[str, Array] = {
        "frame": track.frame,
        "time_s": track.time_s,
        "joint_names": np.asarray(track.joint_names),
        "joint_positions": track.joint_positions,
        "keypoint_definition": np.array(table.keypoint_definition),
    }
    if track.keypoints21 is not None:
        arrays["keypoint_names"] = np.asarray(keypoint_names())
        arrays["keypoints21"] = track.keypoints21
    write_arrays(path, arrays)


# ---- NetCDF


def write_netcdf(path: Path, table: ResultsTable) -> None:
    """Write the arrays of `labelled`, and `isb_angle` and `isb_angle_std` (time, isb) [rad]. What is known beside is attributes."""
    from scipy.io import netcdf_file

    with replacing(path) as part, netcdf_file(part, "w", version=2) as file:
        (coordinates, arrays, attributes), entry = labelled(table.track), about(table)
        words = {"axes": entry["axes"], "description": json.dumps(entry)}
        for name, value in {**attributes, **words}.items():
            if isinstance(value, str):  # the classic format's attributes hold ASCII
                value = value.encode("ascii", "replace").decode() or "-"
            setattr(file, name, value)
        for name, values in coordinates.items():
            _add(file, name, (name,), values, "s")
        for name, (axes, values, unit) in arrays.items():
            _add(file, name, axes, values, unit)
        model, track = table.model, table.track
        if angles := isb_angles(model, track.T_world_bone):
            spread = isb_std(model, track.parameters, track.parameter_std)
            _add(file, "isb", ("isb",), tuple(angles))
            for name, values in (("isb_angle", angles), ("isb_angle_std", spread)):
                _add(file, name, ("time", "isb"), np.stack(list(values.values()), axis=1), "rad")


def _add(
    file: netcdf_file, name: str, axes: tuple[str, ...], given: ArrayLike, unit: str = ""
) -> None:
    """Add an array of numbers, or words: rows of bytes, which the classic format has in the place of text."""
    values, kind = np.asarray(given), "f8"
    if is_text := values.dtype.kind == "U":
        words, kind = np.char.encode(values, "utf-8"), "c"
        width = max(words.dtype.itemsize, 1)
        axes = (*axes, f"letters_{width}")
        values = words.astype(f"S{width}").view("S1").reshape(len(words), width)
    elif values.dtype.kind == "i":
        kind = "i4"
    for axis, length in zip(axes, values.shape, strict=True):
        if axis not in file.dimensions:
            file.createDimension(axis, length)
    variable = file.createVariable(name, kind, axes)
    variable[:] = values.astype(variable[:].dtype)
    if is_text:
        variable._Encoding = "utf-8"
    else:
        variable.units = unit
