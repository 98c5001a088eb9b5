"""Kalibr's camera chains (YAML): each camera's pose from the one before, in metres."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from handtrack.capture.calibration.formats.given_rig import (
    GivenCamera,
    GivenRig,
    is_fisheye,
    matrix_of,
    numbers,
    whole_size,
)
from handtrack.errors import HandtrackError

_UNIT_M = 1.0


def read_kalibr(tree: Any, where: str) -> GivenRig | None:
    """Return the cameras of a chain; None for what is none. Raises HandtrackError."""
    if not isinstance(tree, Mapping):
        return None
    tables = {
        n: t
        for n, t in tree.items()
        if isinstance(t, Mapping) and "distortion_model" in t and "intrinsics" in t
    }
    if not tables:
        return None
    pose, cameras = np.eye(4), []
    for index, (name, table) in enumerate(tables.items()):
        place = f"{where}, {name}"
        if index and "T_cn_cnm1" not in table:
            raise HandtrackError(
                f"{place}: `T_cn_cnm1` is missing, its pose from the camera before; calibrate all together."
            )
        if index:
            step = numbers(table["T_cn_cnm1"], f"{place}, T_cn_cnm1")
            if step.size != 16:
                raise HandtrackError(
                    f"{place}: T_cn_cnm1 has the shape {step.shape}; expected 4 x 4."
                )
            pose = step.reshape(4, 4) @ pose
        cameras.append(_camera(table, str(name), place, pose))
    return GivenRig("Kalibr's camera chain", tuple(cameras), _UNIT_M)


def _camera(
    table: Mapping[str, Any], name: str, where: str, pose: np.ndarray[Any, Any]
) -> GivenCamera:
    values = numbers(table["intrinsics"], f"{where}, intrinsics").ravel()
    model = str(table.get("camera_model", "pinhole"))
    if model == "omni" and len(values) == 5 and values[0] == 0:  # a mirror that is none
        values = values[1:]
    else:
        is_fisheye(model, where)  # raises: of no model that is read
    fisheye = is_fisheye(table["distortion_model"], where)
    if len(values) != 4:
        raise HandtrackError(f"{where}: {len(values)} intrinsics; expected fx, fy, cx, cy.")
    bent = numbers(table.get("distortion_coeffs") or [], f"{where}, distortion_coeffs").ravel()
    size = (
        whole_size(table["resolution"], f"{where}, resolution") if "resolution" in table else None
    )
    matrix = matrix_of(*values.tolist())
    return GivenCamera(name, size, matrix, bent, pose[:3, :3], pose[:3, 3], fisheye)
