"""NetCDF (classic, by SciPy): labelled arrays with units, as xarray, MATLAB and R read them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from handtrack.arrays import Array, Axes
from handtrack.export.isb import isb_angles, isb_std
from handtrack.export.table import ResultsTable
from handtrack.export.tables.cells import about
from handtrack.files.atomic import replacing
from handtrack.tracking.frame.tables.labelled import labelled

if TYPE_CHECKING:
    from scipy.io import netcdf_file


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write the arrays of `labelled`, and `isb_angle` and `isb_angle_std` (time, isb) [rad]. What is known beside is attributes."""
    from scipy.io import netcdf_file

    with replacing(path) as part, netcdf_file(part, "w", version=2) as file:
        (coordinates, arrays, attributes), told = labelled(table.track), about(table)
        words = {"axes": told["axes"], "description": json.dumps(told)}
        for name, value in {**attributes, **words}.items():
            setattr(file, name, (_ascii(value) or "-") if isinstance(value, str) else value)
        for name, values in coordinates.items():
            if isinstance(values, np.ndarray):
                _add(file, name, (name,), values, "s")
            else:
                _labels(file, name, values)
        for name, (axes, values, unit) in arrays.items():
            if values.dtype.kind == "U":
                _labels(file, name, [str(text) for text in values], *axes)
            else:
                _add(file, name, axes, values, unit)
        _isb(file, table)
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
    variable[:] = values.astype(variable[:].dtype)
    variable.units = unit


def _labels(file: netcdf_file, name: str, texts: Sequence[str], axis: str = "") -> None:
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
