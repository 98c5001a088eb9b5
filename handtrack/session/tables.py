"""TrackResult ↔ poses.npz (contracts §5); other formats: handtrack/export/."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import Array, Axes
from handtrack.errors import HandtrackError
from handtrack.files.atomic import check_folder_of, keep_version, replacing
from handtrack.files.npz_files import read_arrays
from handtrack.model.articulated import ArticulatedModel
from handtrack.tracking.frame.reason import KINDS
from handtrack.tracking.frame.result import COLUMNS, FIELDS, Status, TrackResult, model_of
from handtrack.tracking.frame.result_fields import result_fields

FORMAT = 2
"""with the model's hierarchy; files of format 1 are without it, and open"""

_LABELS = [entry for entry in fields(TrackResult) if entry.name not in COLUMNS]
_KNOWN = {
    name: (known.columns[name].kind, known.columns[name].axes)
    for name, known in result_fields(_LABELS).items()
} | {name: (column.kind, ("F", *column.axes)) for name, column in COLUMNS.items()}
"""kind and axes of every array: of labels, which are the same for all frames, and of columns"""
_ALWAYS = [entry.name for entry in _LABELS if "None" not in str(entry.type)] + [
    name for known in FIELDS.values() if not known.is_optional for name in known.columns
]
_GROUPS = [known.group for known in FIELDS.values()]
_KINDS = {str: ("U", "text"), int: ("iu", "whole numbers"), float: ("fiu", "numbers")}


def write_result(path: Path | str, track: TrackResult) -> Path | None:
    """Write a result as poses.npz; what stood there is kept in versions/, and returned."""
    previous = keep_version(Path(path))
    write_npz(path, track)
    return previous


def write_npz(path: Path | str, track: TrackResult) -> None:
    """Write a result whole or not at all. The same result gives the same bytes. Raises HandtrackError where there is no such folder."""
    check_folder_of(path)
    arrays: dict[str, Array] = {"format": np.array(1 if track.definition is None else FORMAT)}
    for field in fields(track):
        value = getattr(track, field.name)
        if value is not None:
            arrays[field.name] = np.asarray(value)
    if track.definition is not None:
        arrays |= anatomy_arrays(model_of(track, str(path)))
    if track.landmarks is not None and track.landmark_covariance is not None:
        arrays |= {
            "landmarks": track.landmarks,
            "landmark_covariance": track.landmark_covariance,
            "landmark_definition": np.array(track.landmark_definition),
        }
    write_arrays(path, arrays)


def write_arrays(path: Path | str, arrays: Mapping[str, Array[*Axes]]) -> None:
    """Write an .npz without dates and pickles, whole or not at all."""
    with replacing(Path(path)) as part, zipfile.ZipFile(part, "w") as archive:
        for name, array in arrays.items():
            data = io.BytesIO()
            np.lib.format.write_array(data, np.asarray(array, order="C"), allow_pickle=False)
            entry = zipfile.ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0))
            entry.compress_type, entry.create_system = zipfile.ZIP_DEFLATED, 3
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, data.getvalue(), compresslevel=1)


def read_npz(path: Path | str) -> TrackResult:
    """Return the result of a poses.npz. Raises HandtrackError saying which array is wrong."""
    path = Path(path)
    if path.is_dir():
        raise HandtrackError(
            f"{path} is a folder; expected a poses.npz. A session's is at tracks/poses.npz in it."
        )
    arrays = read_arrays(path)
    if "format" not in arrays:
        raise HandtrackError(
            f"{path}: no array `format`, so this is no tracked sequence; expected a poses.npz written "
            f"by `handtrack track`. Found: {', '.join(arrays) or 'nothing'}."
        )
    found = arrays["format"]
    if found.shape != () or found.dtype.kind not in "iu" or not 1 <= int(found) <= FORMAT:
        raise HandtrackError(
            f"{path}: format {found.tolist()}; this version of handtrack reads formats 1 and {FORMAT}. "
            "Update handtrack, or track the session again."
        )
    _check_complete(path, arrays)
    values: dict[str, Any] = {**checked_arrays(path, arrays, _KNOWN)}
    for name in values.keys() - COLUMNS.keys():
        kind, axes = _KNOWN[name]
        values[name] = tuple(map(kind, values[name])) if axes else kind(values[name])
    track = TrackResult(**values)
    _check_rows(path, track)
    return track


def _check_complete(path: Path, arrays: Mapping[str, Array]) -> None:
    missing = [name for name in _ALWAYS if name not in arrays]
    if missing:
        raise HandtrackError(
            f"{path}: arrays are missing: {', '.join(missing)}. Found: {', '.join(arrays)}."
        )
    for group in _GROUPS:  # all of them or none
        lacking = [name for name in group if name not in arrays]
        if 0 < len(lacking) < len(group):
            raise HandtrackError(
                f"{path}: arrays are missing: {', '.join(lacking)}; expected all of {', '.join(group)}, or none."
            )


def checked_arrays(
    path: Path, arrays: Mapping[str, Array], known: Mapping[str, tuple[type, tuple[str | int, ...]]]
) -> dict[str, Array]:
    """Return those arrays that are known, of their kinds.

    Parameters
    ----------
    known
        By name the kind, float, int or str, and the axes: lengths, or letters, of which equal ones are equal lengths.

    Raises
    ------
    HandtrackError
        Where one has another shape, or holds something else.
    """
    sizes, found = dict[str | int, int](), dict[str, Array]()
    for name, (kind, axes) in known.items():
        if name not in arrays:
            continue
        array = arrays[name]
        if array.ndim == len(axes):
            for letter, length in zip(axes, array.shape, strict=True):
                if isinstance(letter, str):
                    sizes.setdefault(letter, length)
        expected = tuple(sizes.get(n, n) for n in axes)
        if array.shape != expected:
            raise HandtrackError(
                f"{path}: {name} has the shape {array.shape}; expected {expected}, as the other arrays have it."
            )
        kinds, what = _KINDS[kind]
        if array.dtype.kind not in kinds:
            raise HandtrackError(f"{path}: {name} holds {array.dtype}; expected {what}.")
        found[name] = array if kind is str else array.astype(kind)
    return found


def _check_rows(path: Path, track: TrackResult) -> None:
    if not len(track):
        raise HandtrackError(f"{path}: no frames; expected at least one.")
    if (np.diff(track.frame) <= 0).any():
        raise HandtrackError(
            f"{path}: frame numbers do not ascend; expected each frame once, in order."
        )
    if track.frame[0] < 0:
        raise HandtrackError(f"{path}: frame {track.frame[0]}; expected numbers from 0.")
    for name, column in COLUMNS.items():
        rows = getattr(track, name)
        if rows is None or not column.finite:
            continue
        bad = ~np.isfinite(rows.reshape(len(rows), -1)).all(axis=1)
        if bad.any():
            raise HandtrackError(
                f"{path}: {name} of frame {track.frame[bad][0]} is not finite; a lost frame holds the last estimate."
            )
    kinds = [] if track.reason_kind is None else sorted(set(track.reason_kind) - {"", *KINDS})
    if kinds:
        raise HandtrackError(
            f"{path}: reason_kind has the unknown value '{kinds[0]}'; expected one of {', '.join(KINDS)}."
        )
    known = [int(status) for status in Status]
    if not np.isin(track.status, known).all():
        raise HandtrackError(f"{path}: status has values other than {known[0]} to {known[-1]}.")


# ---- How the model of a result is built: hierarchy, rest pose, hinges, limits. For readers who have the file alone


AXES = (
    "world: right-handed, as the camera calibration has it; bone: origin at its proximal end, +y along it, +z dorsal; "
    "T_a_b maps b to a"
)


def anatomy_arrays(model: ArticulatedModel) -> dict[str, Array[*Axes]]:
    """Return what poses.npz says of a model, by key.

    `parents` (B,), −1 for the root; `rest_T_bone` (B, 4, 4) bone → root in the zero pose [m]; `bone_length` (B,) [m];
    `hinge_bone` (S − 6,) the bone that each parameter after the root's six turns, `hinge_axis` (S − 6, 3) about which axis of
    its rest frame, in this order; `parameter_limits` (S, 2) [m, rad]; `joint_bone` (J,) and `joint_point` (J, 3) [m], where
    each named joint is in its bone's frame; `axes`, `unit`.
    """
    skeleton = model.skeleton
    rest = model.bones(model.params_from({})).T_world_bone
    return {
        "parents": np.asarray(skeleton.parent, np.int64),
        "rest_T_bone": rest,
        "bone_length": skeleton.length,
        "hinge_bone": np.asarray(skeleton.hinge_bone, np.int64),
        "hinge_axis": skeleton.hinge_axis,
        "parameter_limits": model.limits.interval,
        "joint_bone": np.asarray(model.joint_bone, np.int64),
        "joint_point": model.joint_point,
        "axes": np.array(AXES),
        "unit": np.array("m"),
    }
