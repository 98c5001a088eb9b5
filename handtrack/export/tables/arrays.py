"""Arrays: poses.npz again, joint positions alone, and NetCDF (classic, by SciPy) as xarray, MATLAB and R read it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from handtrack.arrays import Array
from handtrack.export.isb import isb_angles, isb_std
from handtrack.export.table import ResultsTable
from handtrack.export.tables.csv_tables import about
from handtrack.files.atomic import replacing
from handtrack.model.articulated import keypoint_names
from handtrack.session.formats.tables import write_arrays, write_npz
from handtrack.tracking.frame.tables.labelled import labelled

if TYPE_CHECKING:
    from scipy.io import netcdf_file


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
