"""TrackResult ↔ poses.npz (contracts §5); other formats: handtrack/export/."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np

from handtrack.arrays import Array, Axes
from handtrack.errors import HandtrackError
from handtrack.files.atomic import replacing
from handtrack.files.npz_files import read_arrays
from handtrack.files.versions import keep_version
from handtrack.session.formats.anatomy import anatomy_arrays
from handtrack.tracking.frame.reason import KINDS
from handtrack.tracking.frame.result import Status, TrackResult
from handtrack.tracking.frame.tables.track_model import model_of

FORMAT = 2
"""with the model's hierarchy; files of format 1 are without it, and open"""

_NAMES = ("parameter_names", "bone_names", "joint_names", "energy_names", "part_names")
_TEXTS = ("model", "side", "scale", "session", "settings", "version", "keypoint_definition")
_WHOLE = ("frame", "status", "iterations", "views", "hypothesis_parent", "take")
_FINITE = ("time_s", "parameters", "T_world_bone", "joint_positions", "keypoints21")
_JSON = ("refinement", "definition", "cameras", "pins")
_SCALARS = ("start_confidence", "hand_length_mm", "hand_length_std_mm", "fps")
_SHAPES: dict[str, tuple[str | int, ...]] = {
    "frame": ("F",),
    "time_s": ("F",),
    "parameter_names": ("S",),
    "parameters": ("F", "S"),
    "bone_names": ("B",),
    "T_world_bone": ("F", "B", 4, 4),
    "joint_names": ("J",),
    "joint_positions": ("F", "J", 3),
    "keypoints21": ("F", 21, 3),
    "status": ("F",),
    "energy": ("F",),
    "iterations": ("F",),
    "views": ("F",),
    "parameter_std": ("F", "S"),
    "joint_covariance": ("F", "J", 3, 3),
    "energy_names": ("T",),
    "energies": ("F", "T"),
    "reason": ("F",),
    "reason_kind": ("F",),
    "reason_where": ("F", 2),
    "reason_numbers": ("F", 2),
    "p_off_25mm": ("F",),
    "p_off_10mm": ("F", "N"),
    "part_names": ("N",),
    "hypothesis_parameters": ("F", "H", "S"),
    "hypothesis_energy": ("F", "H"),
    "hypothesis_weight": ("F", "H"),
    "hypothesis_parent": ("F", "H"),
    "hypothesis_origin": ("F", "H"),
    **dict.fromkeys((*_SCALARS, "take", *_TEXTS, *_JSON), ()),
}
_REASON = ("reason", "reason_kind", "reason_where", "reason_numbers")
_OFF = ("p_off_10mm", "part_names")
_HYPOTHESES = tuple(name for name in _SHAPES if name.startswith("hypothesis_"))
_OPTIONAL = (
    "keypoints21", "keypoint_definition", "views", "energy_names", "energies", "take", "p_off_25mm", *_JSON, *_SCALARS, *_REASON, *_OFF, *_HYPOTHESES
)  # fmt: skip
_WORDS = ("reason", "reason_kind", "reason_where", "hypothesis_origin")
"""arrays of text, a row a frame"""


def write_result(path: Path | str, track: TrackResult) -> Path | None:
    """Write a result as poses.npz; what stood there is kept in versions/, and returned."""
    previous = keep_version(Path(path))
    write_npz(path, track)
    return previous


def write_npz(path: Path | str, track: TrackResult) -> None:
    """Write a result whole or not at all. The same result gives the same bytes."""
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
    _check_shapes(path, arrays)
    values: dict[str, object] = {}
    for name in _SHAPES:
        values[name] = _value(path, name, arrays[name]) if name in arrays else None
    track = TrackResult(**values)  # type: ignore[arg-type]
    _check_rows(path, track)
    return track


def _check_shapes(path: Path, arrays: Mapping[str, Array]) -> None:
    missing = [name for name in _SHAPES if name not in arrays and name not in _OPTIONAL]
    if missing:
        raise HandtrackError(
            f"{path}: arrays are missing: {', '.join(missing)}. Found: {', '.join(arrays)}."
        )
    for group in (_REASON, _OFF, _HYPOTHESES):  # all of them or none
        lacking = [name for name in group if name not in arrays]
        if 0 < len(lacking) < len(group):
            raise HandtrackError(
                f"{path}: arrays are missing: {', '.join(lacking)}; expected all of {', '.join(group)}, or none."
            )
    sizes: dict[str | int, int] = {}
    for name, shape in _SHAPES.items():
        if name not in arrays:
            continue
        have = arrays[name].shape
        if len(have) == len(shape):
            for letter, length in zip(shape, have, strict=True):
                if isinstance(letter, str):
                    sizes.setdefault(letter, length)
        expected = tuple(sizes.get(n, n) if isinstance(n, str) else n for n in shape)
        if have != expected:
            raise HandtrackError(
                f"{path}: {name} has the shape {have}; expected {expected}, as the other arrays have it."
            )


def _value(path: Path, name: str, array: Array) -> object:
    kinds = (
        "U" if name in (*_NAMES, *_TEXTS, *_WORDS, *_JSON) else "iu" if name in _WHOLE else "fiu"
    )
    if array.dtype.kind not in kinds:
        what = {"U": "text", "iu": "whole numbers", "fiu": "numbers"}[kinds]
        raise HandtrackError(f"{path}: {name} holds {array.dtype}; expected {what}.")
    if name in _NAMES:
        return tuple(str(text) for text in array)
    if name in (*_TEXTS, *_JSON):
        return str(array)
    if name in _WORDS:
        return array
    kind = int if name in _WHOLE else float
    return kind(array) if not array.ndim else array.astype(np.int64 if kind is int else float)


def _check_rows(path: Path, track: TrackResult) -> None:
    if not len(track):
        raise HandtrackError(f"{path}: no frames; expected at least one.")
    if (np.diff(track.frame) <= 0).any():
        raise HandtrackError(
            f"{path}: frame numbers do not ascend; expected each frame once, in order."
        )
    if track.frame[0] < 0:
        raise HandtrackError(f"{path}: frame {track.frame[0]}; expected numbers from 0.")
    for name in _FINITE:
        rows = getattr(track, name)
        if rows is None:
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


def is_length(parameter: str) -> bool:
    """Return whether a joint parameter is a translation [m]; the others are angles [rad]."""
    return parameter.endswith(("_tx", "_ty", "_tz"))
