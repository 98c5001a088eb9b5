"""A track's numbers by their names: one angle, a table for pandas, an array with axes for xarray."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from handtrack.arrays import D3, F, Floats, Ints, J, S
from handtrack.errors import HandtrackError, unknown_name

if TYPE_CHECKING:
    import pandas
    import xarray

_LENGTHS = ("root_tx", "root_ty", "root_tz")
"""parameters that are no angles"""


class NamedTrack:
    """What TrackResult answers by name; the arrays are its own."""

    frame: Ints[F]
    time_s: Floats[F]
    parameter_names: tuple[str, ...]
    parameters: Floats[F, S]
    parameter_std: Floats[F, S]
    joint_names: tuple[str, ...]
    joint_positions: Floats[F, J, D3]
    joint_covariance: Floats[F, J, D3, D3]
    status: Ints[F]
    energy: Floats[F]

    def angle(self, name: str, degrees: bool = True) -> Floats[F]:
        """Return a joint's angle in every frame, such as `index_pip_flex`. Raises HandtrackError for a name it does not have."""
        angles = [n for n in self.parameter_names if n not in _LENGTHS]
        if name not in angles:
            raise unknown_name("angle", name, angles)
        value = self.parameters[:, self.parameter_names.index(name)]
        return np.rad2deg(value) if degrees else value.copy()

    def std(self, name: str, degrees: bool = True) -> Floats[F]:
        """Return an angle's standard deviation in every frame; infinite where it is open. Raises HandtrackError as `angle`."""
        self.angle(name)
        value = self.parameter_std[:, self.parameter_names.index(name)]
        return np.rad2deg(value) if degrees else value.copy()

    def joint(self, name: str) -> Floats[F, D3]:
        """Return a joint's place in every frame, world [m]. Raises HandtrackError for a name it does not have."""
        if name not in self.joint_names:
            raise unknown_name("joint", name, self.joint_names)
        return self.joint_positions[:, self.joint_names.index(name)].copy()

    def to_dataframe(self) -> pandas.DataFrame:
        """Return a table with a row for each frame (its index): the columns of the CSV, and each angle's standard deviation.

        Angles in degrees, places in metres, as their names say. Raises HandtrackError where pandas is not installed.
        """
        columns: dict[str, Any] = {
            "time_s": self.time_s, "status": self.status, "energy": self.energy,
        }  # fmt: skip
        for row, name in enumerate(self.parameter_names):
            unit, factor = ("m", 1.0) if name in _LENGTHS else ("deg", 180.0 / np.pi)
            columns[f"{name}_{unit}"] = factor * self.parameters[:, row]
            columns[f"{name}_std_{unit}"] = factor * self.parameter_std[:, row]
        for row, name in enumerate(self.joint_names):
            for axis, letter in enumerate("xyz"):
                columns[f"{name}_{letter}_m"] = self.joint_positions[:, row, axis]
        index = _library("pandas").Index(self.frame, name="frame")
        return _library("pandas").DataFrame(columns, index=index)

    def to_xarray(self) -> xarray.Dataset:
        """Return a dataset with the axes time, space, keypoints, individuals and parameter, as `movement` takes it and
        `handtrack export --to netcdf` writes it, in radians and metres; positions of lost frames are NaN.

        Raises HandtrackError where xarray is not installed.
        """
        from handtrack.tracking.frame.tables.labelled import (
            labelled,  # which needs the result itself
        )

        known = labelled(self)  # pyright: ignore[reportArgumentType]
        arrays = {name: (a.axes, a.values, {"units": a.unit}) for name, a in known.arrays.items()}
        words = {name: (name, np.asarray(values)) for name, values in known.coordinates.items()}
        return _library("xarray").Dataset(arrays, words, dict(known.attributes))


def _library(name: str) -> ModuleType:
    """Return an optional library; HandtrackError that says how to install it."""
    try:
        return import_module(name)
    except ImportError:
        raise HandtrackError(
            f"{name} is not installed, which this table is made with: `pip install {name}`, or handtrack with the extra "
            "`tables`. Without it, `parameters` and `joint_positions` are plain arrays, with `parameter_names` and `joint_names`."
        ) from None
