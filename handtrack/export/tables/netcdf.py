"""NetCDF (classic, by SciPy): labelled arrays with units, as xarray, MATLAB and R read them, and as `movement` names them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from handtrack.arrays import Array, Axes
from handtrack.export.isb import isb_angles, isb_std
from handtrack.export.table import ResultsTable
from handtrack.export.tables.sidecar import about
from handtrack.files.atomic import replacing

if TYPE_CHECKING:
    from scipy.io import netcdf_file


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write arrays with these axes: `time` [s], `space`, `keypoints`, `individuals` (one), `parameter`, `bone`.

    `position` and `position_std` (time, space, keypoints, individuals) [m], `confidence` (time, keypoints, individuals); `angle` and
    `angle_std` (time, parameter) [m, rad]; `isb_angle` and `isb_angle_std` (time, isb) [rad]; `T_world_bone` (time, bone, row, column) [m]; `status`,
    `frame`, `p_off_25mm`, `p_off_10mm`, `reason`. Positions of lost frames are NaN. What is known beside is attributes.
    """
    from scipy.io import netcdf_file

    track, lost = table.track, table.is_lost[:, None, None]
    with replacing(path) as part, netcdf_file(part, "w", version=2) as file:
        told = about(table)
        file.source_software, file.ds_type = "handtrack", "poses"
        file.fps, file.time_unit = float(table.fps), "seconds"
        for name in ("session", "model", "side", "axes"):
            setattr(file, name, _ascii(told[name]) or "-")
        file.description = _ascii(json.dumps(told))
        _add(file, "time", ("time",), track.time_s, "s")
        _labels(file, "space", ("x", "y", "z"))
        _labels(file, "keypoints", track.joint_names)
        _labels(
            file, "individuals", (track.side if track.keypoints21 is not None else track.model,)
        )
        _labels(file, "parameter", track.parameter_names)
        _labels(file, "bone", track.bone_names)
        axes = ("time", "space", "keypoints", "individuals")
        for name, values in (
            ("position", track.joint_positions),
            ("position_std", table.joint_std),
        ):
            shown = np.where(lost, np.nan, values).transpose(0, 2, 1)[..., None]
            _add(file, name, axes, shown, "m")
        sure = table.confidence()[..., None]
        _add(file, "confidence", ("time", "keypoints", "individuals"), sure, "1")
        for name, values in (("angle", track.parameters), ("angle_std", track.parameter_std)):
            _add(file, name, ("time", "parameter"), values, "rad; m for root_tx, root_ty, root_tz")
        _isb(file, table)
        _add(file, "T_world_bone", ("time", "bone", "row", "column"), track.T_world_bone, "m")
        _add(file, "frame", ("time",), track.frame.astype(np.int32), "1")
        _add(file, "status", ("time",), track.status.astype(np.int32), "1")
        if track.p_off_25mm is not None:
            _add(file, "p_off_25mm", ("time",), track.p_off_25mm, "1")
        if track.p_off_10mm is not None and track.part_names is not None:
            _labels(file, "part", track.part_names)
            _add(file, "p_off_10mm", ("time", "part"), track.p_off_10mm, "1")
        if track.reason is not None:
            _labels(file, "reason", [str(text) for text in track.reason], "time")
    return [path]


def _isb(file: netcdf_file, table: ResultsTable) -> None:
    model, track = table.model, table.track
    angles = isb_angles(model, track.T_world_bone)
    if not angles:
        return
    spread = isb_std(model, track.parameters, track.parameter_std)
    _labels(file, "isb", tuple(angles))
    for name, values in (("isb_angle", angles), ("isb_angle_std", spread)):
        _add(file, name, ("time", "isb"), np.stack(list(values.values()), axis=1), "rad")


def _add(
    file: netcdf_file, name: str, axes: tuple[str, ...], values: Array[*Axes], unit: str
) -> None:
    for axis, length in zip(axes, values.shape, strict=True):
        if axis not in file.dimensions:
            file.createDimension(axis, length)
    variable = file.createVariable(name, "i4" if values.dtype.kind == "i" else "f8", axes)
    variable[:] = values
    variable.units = unit


def _labels(
    file: netcdf_file, name: str, texts: tuple[str, ...] | list[str], axis: str = ""
) -> None:
    """Add words: rows of bytes, which the classic format has in the place of text."""
    axis = axis or name
    data = [text.encode() for text in texts]
    width = max(1, *(len(row) for row in data))
    if axis not in file.dimensions:
        file.createDimension(axis, len(data))
    letters = f"letters_{width}"
    if letters not in file.dimensions:
        file.createDimension(letters, width)
    variable = file.createVariable(name, "c", (axis, letters))
    variable[:] = np.array(data, f"S{width}").view("S1").reshape(len(data), width)
    variable._Encoding = "utf-8"


def _ascii(text: str) -> str:
    """Return text that the classic format's attributes can hold."""
    return text.encode("ascii", "replace").decode()
