"""NetCDF (classic, by SciPy): labelled arrays with units, as xarray, MATLAB and R read them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from handtrack.export.isb import isb_angles, isb_std
from handtrack.export.table import ResultsTable
from handtrack.export.tables.cells import about
from handtrack.files.atomic import replacing
from handtrack.tracking.frame.tables.labelled import labelled

if TYPE_CHECKING:
    from scipy.io import netcdf_file


def write(path: Path, table: ResultsTable) -> None:
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
