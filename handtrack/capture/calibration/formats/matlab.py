"""MATLAB's stereoParameters, as an object, as a struct or as JSON: vectors stand in rows, and the first pixel is (1, 1).

And the stereo calibration of Bouguet's toolbox (Calib_Results_stereo.mat), whose first pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from handtrack.arrays import D3, Floats
from handtrack.capture.calibration.formats.camera_tables import UNITS_M
from handtrack.capture.calibration.formats.given_rig import (
    GivenCamera,
    GivenRig,
    matrix_of,
    numbers,
    rotation_of,
    whole_size,
)
from handtrack.errors import HandtrackError

_FIRST_PIXEL = 1.0
_MARK = "CameraParameters1"
_MIDDLE = 0.2  # of the image: how far from its middle a lens's axis may be
HOW = "In MATLAB: s = toStruct(stereoParams); save('stereo.mat', 's', '-v7'), or write jsonencode(s) to a .json file."


def read_matlab(tree: Any, where: str) -> GivenRig | None:
    """Return the two cameras; None for what is no stereoParameters. Raises HandtrackError."""
    table = _found(tree, _MARK)
    if table is None and _found(tree, "RadialDistortion") is not None:
        raise HandtrackError(
            f"{where}: the lens of one camera, without the cameras' places. Give stereoParams, which stereoCameraCalibrator saves."
        )
    if table is None:
        return None
    parts = [table.get(f"CameraParameters{i}") for i in (1, 2)]
    if not all(isinstance(part, Mapping) for part in parts):
        raise HandtrackError(f"{where}: CameraParameters1 and 2 must be structs. {HOW}")
    first, second = (dict(part) for part in parts if isinstance(part, Mapping))
    rotation, translation = _pose(table, where)
    cameras = (
        _camera(first, f"{where}, CameraParameters1", np.eye(3), np.zeros(3)),
        _camera(second, f"{where}, CameraParameters2", rotation, translation),
    )
    said = str(first.get("WorldUnits") or table.get("WorldUnits") or "mm").lower()
    if said not in UNITS_M:
        raise HandtrackError(
            f"{where}: WorldUnits = '{said}'; expected one of {', '.join(UNITS_M)}."
        )
    return GivenRig("MATLAB's stereoParameters", cameras, UNITS_M[said])


def read_bouguet(tree: Any, where: str) -> GivenRig | None:
    """Return the two cameras of Bouguet's toolbox; None for anything else. Raises HandtrackError for one camera alone."""
    if not isinstance(tree, Mapping) or not any(key.startswith(("fc", "fc_left")) for key in tree):
        return None
    if not {"fc_left", "fc_right", "R", "T"} <= tree.keys():
        raise HandtrackError(
            f"{where}: a lens of Bouguet's toolbox, without the cameras' places. Give Calib_Results_stereo.mat, which "
            "stereo_gui saves."
        )
    size = None
    if "nx" in tree and "ny" in tree:
        size = whole_size(
            [float(np.ravel(tree[key])[0]) for key in ("nx", "ny")], f"{where}, nx ny"
        )
    poses = {"left": (np.eye(3), np.zeros(3)), "right": (rotation_of(tree["R"], f"{where}, R"),
             _shaped(tree["T"], (3,), f"{where}, T"))}  # fmt: skip
    cameras = []
    for side, (rotation, translation) in poses.items():
        focal, centre = (
            _shaped(tree[f"{n}_{side}"], (2,), f"{where}, {n}_{side}") for n in ("fc", "cc")
        )
        matrix = matrix_of(*focal.tolist(), *centre.tolist())
        skew = numbers(tree.get(f"alpha_c_{side}", 0.0), f"{where}, alpha_c_{side}").ravel()
        matrix[0, 1] = focal[0] * skew[0]
        bent = _row(tree, f"kc_{side}", where)
        fits = size is not None and np.abs(centre / size - 0.5).max() < _MIDDLE
        own = size if fits else None  # it is one camera's, and the other may be larger
        cameras.append(GivenCamera(None, own, matrix, bent, rotation, translation))
    return GivenRig("Bouguet's stereo calibration", tuple(cameras))


def _found(tree: Any, mark: str) -> Mapping[str, Any] | None:
    """Return the first table with a key, at most three levels down: calibrationSession.mat has it below its session."""
    tables = [tree] if isinstance(tree, Mapping) else []
    for _ in range(4):
        for table in tables:
            if mark in table:
                return table
        tables = [v for table in tables for v in table.values() if isinstance(v, Mapping)]
    return None


def _pose(table: Mapping[str, Any], where: str) -> tuple[Floats[D3, D3], Floats[D3]]:
    pose = table.get("PoseCamera2")
    if "RotationOfCamera2" in table and "TranslationOfCamera2" in table:  # x₂ = x₁ R + t, with rows
        turned, moved = table["RotationOfCamera2"], table["TranslationOfCamera2"]
        rotation = _shaped(turned, (3, 3), f"{where}, RotationOfCamera2").T
        return rotation, _shaped(moved, (3,), f"{where}, TranslationOfCamera2")
    if isinstance(pose, Mapping) and "R" in pose and "Translation" in pose:  # rigidtform3d: columns
        rotation = _shaped(pose["R"], (3, 3), f"{where}, PoseCamera2.R")
        return rotation, _shaped(pose["Translation"], (3,), f"{where}, PoseCamera2.Translation")
    if isinstance(pose, Mapping) and "A" in pose:
        whole = _shaped(pose["A"], (4, 4), f"{where}, PoseCamera2.A")
        return whole[:3, :3], whole[:3, 3]
    raise HandtrackError(
        f"{where}: neither RotationOfCamera2 with TranslationOfCamera2, nor PoseCamera2 as a struct (R, Translation). {HOW}"
    )


def _camera(
    part: Mapping[str, Any], where: str, rotation: Floats[D3, D3], translation: Floats[D3]
) -> GivenCamera:
    radial = _row(part, "RadialDistortion", where)
    tangential = _row(part, "TangentialDistortion", where)
    if len(radial) > 3 or len(tangential) > 2:
        raise HandtrackError(
            f"{where}: {len(radial)} radial coefficients; expected 2 or 3, and 2 tangential."
        )
    radial = np.concatenate([radial, np.zeros(3 - len(radial))])
    tangential = np.concatenate([tangential, np.zeros(2 - len(tangential))])
    size = numbers(part.get("ImageSize", []), f"{where}, ImageSize").ravel()
    return GivenCamera(
        None,
        whole_size(size[::-1], f"{where}, ImageSize") if len(size) else None,  # rows, columns
        _matrix(part, where),
        np.concatenate([radial[:2], tangential, radial[2:]]),
        rotation,
        translation,
    )


def _matrix(part: Mapping[str, Any], where: str) -> Floats[D3, D3]:
    inner = part.get("Intrinsics")
    table = {**inner, **part} if isinstance(inner, Mapping) else part
    if "K" in table:
        matrix = _shaped(table["K"], (3, 3), f"{where}, K")
    elif "IntrinsicMatrix" in table:
        matrix = _shaped(table["IntrinsicMatrix"], (3, 3), f"{where}, IntrinsicMatrix").T
        if np.abs(matrix[2, :2]).max() > 0 and np.abs(matrix[:2, 2]).max() == 0:  # turned on export
            matrix = matrix.T
    elif "FocalLength" in table and "PrincipalPoint" in table:
        focal = _shaped(table["FocalLength"], (2,), f"{where}, FocalLength")
        centre = _shaped(table["PrincipalPoint"], (2,), f"{where}, PrincipalPoint")
        matrix = matrix_of(*focal.tolist(), *centre.tolist())
    else:
        raise HandtrackError(f"{where}: neither K, nor IntrinsicMatrix, nor FocalLength. {HOW}")
    matrix = matrix.copy()
    matrix[:2, 2] -= _FIRST_PIXEL
    return matrix


def _row(part: Mapping[str, Any], key: str, where: str) -> Floats:
    return numbers(part.get(key, []), f"{where}, {key}").ravel()


def _shaped(value: Any, shape: tuple[int, ...], where: str) -> Floats:
    array = numbers(value, where)
    if array.size != np.prod(shape):
        raise HandtrackError(
            f"{where}: {array.size} numbers; expected {' x '.join(map(str, shape))}."
        )
    return array.reshape(shape)
