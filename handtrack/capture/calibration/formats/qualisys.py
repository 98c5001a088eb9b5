"""Qualisys Track Manager's calibration (XML, also as .qca.txt): millimetres, lengths in the image in 64ths of a pixel."""

from __future__ import annotations

import math
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from handtrack.capture.calibration.formats.given_rig import GivenCamera, GivenRig, matrix_of
from handtrack.errors import HandtrackError

_PER_PIXEL = 64.0
_MAY_LACK = ("skew", "radialDistortion3", "viewrotation")  # and are 0 then
_UNIT_M = 1e-3
_TO_OPENCV = np.diag([1.0, -1.0, -1.0])  # their cameras look along −z, y up


def read_qualisys(root: Any, where: str) -> GivenRig | None:
    """Return the calibrated cameras, named by serial number; None for other XML. Raises HandtrackError."""
    if not isinstance(root, Element):
        return None
    cameras = [
        e
        for e in root.iter("camera")
        if e.find("intrinsic") is not None and e.find("transform") is not None
    ]
    cameras = [e for e in cameras if e.get("calibrated", "true").lower() != "false"]
    if not cameras:
        return None
    return GivenRig(
        "Qualisys calibration",
        tuple(_camera(e, f"{where}, camera {e.get('serial')}") for e in cameras),
        _UNIT_M,
    )


def _camera(element: Element, where: str) -> GivenCamera:
    intrinsic, transform, field = (element.find(n) for n in ("intrinsic", "transform", "fov_video"))
    assert intrinsic is not None
    assert transform is not None
    if _number(element, "viewrotation", where) % 360:
        raise HandtrackError(
            f"{where}: its view is turned by {element.get('viewrotation')}°, its calibration is not. Set the view rotation to "
            "0 in QTM, and export video and calibration again."
        )
    fx, fy, cx, cy, skew = (
        _number(intrinsic, key, where) / _PER_PIXEL
        for key in ("focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "skew")
    )
    k1, k2, k3, p1, p2 = (
        _number(intrinsic, key, where)
        for key in (
            *(f"radialDistortion{i}" for i in (1, 2, 3)), *(f"tangentalDistortion{i}" for i in (1, 2)),
        )
    )  # fmt: skip
    if field is not None:
        left, top, right, bottom = (
            _number(field, key, where) for key in ("left", "top", "right", "bottom")
        )
        size = round(right - left) + 1, round(bottom - top) + 1
    else:
        left = top = 0.0
        size = tuple(
            math.ceil((_number(intrinsic, key, where) + 1) / _PER_PIXEL)
            for key in ("sensorMaxU", "sensorMaxV")
        )
    matrix = matrix_of(fx, fy, cx - left, cy - top)
    matrix[0, 1] = skew
    turned = np.array(
        [[_number(transform, f"r{i}{k}", where) for k in (1, 2, 3)] for i in (1, 2, 3)]
    )
    centre = np.array([_number(transform, axis, where) for axis in "xyz"])
    rotation = _TO_OPENCV @ turned
    name = element.get("serial") or None
    return GivenCamera(
        name,
        (size[0], size[1]),
        matrix,
        np.array([k1, k2, p1, p2, k3]),
        rotation,
        -rotation @ centre,
    )


def _number(element: Element, key: str, where: str) -> float:
    text = element.get(key, "0" if key in _MAY_LACK else "")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise HandtrackError(f"{where}: {element.tag} {key} = '{text}'; expected a number.")
    return value
