"""Camera rigs as TOML in the form that Anipose, Pose2Sim and FreeMoCap read and write.

One table per camera with `name`, `size`, `matrix`, `distortions`, `rotation` (rotation vector,
world → camera) and `translation`. Other tables and other keys are ignored.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from handtrack.capture.calibration.formats.imported_rig import (
    is_fisheye,
    numbers,
    numbers_at,
    whole_size,
)
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import read_toml
from handtrack.geometry.camera import Camera, CameraRig
from handtrack.geometry.rotation import rotation_matrix, rotation_vector

_KEYS = ("name", "size", "matrix", "distortions", "rotation", "translation")


def read_rig(path: Path, world_unit_m: float = 1.0) -> CameraRig:
    """Return the cameras of a calibration file, translations in metres.

    Parameters
    ----------
    world_unit_m
        Metres in one unit of the file.

    Raises
    ------
    HandtrackError
        Naming the file and the camera.
    """
    tables = read_toml(Path(path), "the camera calibration")
    found = {name: t for name, t in tables.items() if _is_camera(t)}
    if not found:
        raise HandtrackError(
            f"{path}: no camera found; expected one table per camera with the keys "
            f"{', '.join(_KEYS)}."
        )
    cameras = tuple(
        _camera(table, f"{path}, [{name}]", world_unit_m) for name, table in found.items()
    )
    try:
        return CameraRig(cameras)
    except HandtrackError as error:
        raise HandtrackError(f"{path}: {error}") from None


def write_rig(path: Path, rig: CameraRig) -> None:
    """Write a rig in the same form, in metres."""
    import tomlkit  # slow to import, and most commands only read

    tables = {f"cam_{index}": _table(camera) for index, camera in enumerate(rig)}
    text = tomlkit.dumps({**tables, "metadata": {"adjusted": False}})
    Path(path).write_text(text, encoding="utf-8")


def rig_json(rig: CameraRig) -> str:
    """Return the cameras as JSON: a list of the tables that a calibration file has, translations in metres."""
    return json.dumps([_table(camera) for camera in rig])


def rig_from_json(text: str, where: str) -> CameraRig:
    """Return the cameras that `rig_json` wrote. where: the text's place, for errors. Raises HandtrackError."""
    try:
        tables = json.loads(text)
    except ValueError as error:
        raise HandtrackError(f"{where}: no JSON ({error}).") from None
    if not isinstance(tables, list) or not all(_is_camera(table) for table in tables):
        raise HandtrackError(
            f"{where}: expected a list of cameras with the keys {', '.join(_KEYS)}."
        )
    return CameraRig(tuple(_camera(t, f"{where}, camera {i}", 1.0) for i, t in enumerate(tables)))


def _table(camera: Camera) -> dict[str, Any]:
    return {
        "name": camera.name,
        "size": list(camera.size),
        "matrix": camera.matrix.tolist(),
        "distortions": camera.distortions.tolist(),
        "rotation": rotation_vector(camera.rotation).tolist(),
        "translation": camera.translation.tolist(),
    }


def _is_camera(table: Any) -> bool:
    return isinstance(table, dict) and any(key in table for key in _KEYS[2:])


def _camera(table: dict[str, Any], where: str, world_unit_m: float) -> Camera:
    missing = [key for key in _KEYS if key not in table]
    if missing:
        raise HandtrackError(
            f"{where}: the key '{missing[0]}' is missing; a camera needs {', '.join(_KEYS)}."
        )
    if is_fisheye(table.get("fisheye") or "", f"{where}, fisheye"):
        raise HandtrackError(
            f"{where}: fisheye = {str(table['fisheye']).lower()}; fisheye lenses are not supported. Calibrate with the "
            "standard model (8 coefficients for wide lenses), or undistort the images first."
        )
    if not isinstance(table["name"], str) or not table["name"]:
        raise HandtrackError(f"{where}: name = {table['name']!r}; expected a text.")
    turn = numbers(
        table["rotation"], f"{where}, rotation", (3,), expected="3, a rotation vector (Rodrigues)"
    )
    values = {
        "size": whole_size(table["size"], f"{where}, size"),
        "matrix": numbers_at(table, "matrix", where, (3, 3)),
        "distortions": numbers_at(table, "distortions", where).ravel(),
        "translation": numbers_at(table, "translation", where, (3,)) * world_unit_m,
    }
    try:
        return Camera(name=table["name"], rotation=rotation_matrix(turn), **values)
    except HandtrackError as error:
        raise HandtrackError(f"{where}: {error}") from None
