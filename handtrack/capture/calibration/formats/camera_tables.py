"""Cameras as tables of K, distortion, R and t under the names that people give them: a file a camera, one table a camera, stacked
arrays, or keys with the camera's name in them; and OpenCV's stereo pairs (K1, D1, K2, D2, R, T).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from handtrack.arrays import D3, Floats
from handtrack.capture.calibration.formats.imported_rig import (
    ImportedCamera,
    ImportedRig,
    is_fisheye,
    numbers,
    plain_word,
    rotation_of,
    whole_size,
)
from handtrack.errors import HandtrackError
from handtrack.files.text_files import metres_in
from handtrack.geometry.camera import camera_matrix
from handtrack.geometry.source_lens import FISHEYE_COUNT

_FOCAL_AND_CENTRE = ("fx", "fy", "cx", "cy")
_NAMES = {
    "matrix": "k matrix cameramatrix intrinsics intrinsic intrinsicmatrix intrinsicsmatrix mtx kmatrix kmat cammatrix m",
    "distortions": "d dist distortions distortion distcoeffs distcoeff distcoef distcoefs distortioncoefficients "
    "distortioncoeffs distortionscoefficients distortioncoef kc",
    "rotation": "r rotation rot rotationmatrix rvec rvecs rotationvector rmat rodrigues rotmatrix rotmat rworldtocam rworldtocamera",
    "translation": "t translation trans tvec tvecs translationvector transvector tworldtocam tworldtocamera",
    "pose": "rt extrinsics extrinsic extrinsicmatrix extrinsicsmatrix worldtocamera worldtocam w2c tcameraworld tcamworld tcw",
    "rectification": "rectificationmatrix rectification",
    "projection": "projectionmatrix p",
    "size": "size shape imageshape imagesize imsize resolution imageresolution imgsize sizepx imageshapewh",
    "width": "width imagewidth w",
    "height": "height imageheight h",
    "model": "model cameramodel distortionmodel lensmodel projectionmodel",
    "fisheye": "fisheye isfisheye",
    "name": "name cameraname camname",
    "unit": "unit units worldunits worldunit lengthunit translationunit",
    "inverse": "c2w cameratoworld camtoworld tworldcamera tworldcam twc",
    **{name: name for name in (*_FOCAL_AND_CENTRE, "xi")},
}
MEANS = {name: field for field, names in _NAMES.items() for name in names.split()}
"""our name of each key that people write, in small letters and digits alone"""
_STEREO = re.compile(r"^(.*?)_?(1|2|left|right|l|r)$", re.IGNORECASE)
_LIMIT = 64  # cameras
_MIDDLE = 0.05  # of the image: exchanged sides of 10:9 move its middle by as much
_LEAST_FOCAL_PX = 10.0  # less is in millimetres, or a share of the image's width


def read_tables(tree: Mapping[str, Any] | list[Any], where: str, alone: str) -> ImportedRig | None:
    """Return the cameras of nested tables; None where there are none.

    Parameters
    ----------
    alone
        The name of a camera that has the whole file.

    Raises
    ------
    HandtrackError
        Naming the camera and the key.
    """
    pair: list[tuple[str | None, Mapping[str, Any]]] = []
    if isinstance(tree, Mapping):
        inner = [
            key for key in tree if plain_word(key) in ("cameras", "calibration", "cams", "rig")
        ]
        if len(inner) == 1 and isinstance(tree[inner[0]], Mapping | list):
            found = read_tables(tree[inner[0]], where, alone)
            return found and _in_unit(found, tree, where)
        if any(re.fullmatch("xi(l|r|1|2|left|right)?", plain_word(key)) for key in tree):
            raise _mirror(where)
        pair = _stereo(tree)
    tables = pair or _tables(tree, alone)
    if not tables:
        below = tree.values() if isinstance(tree, Mapping) else ()
        rigs = (read_tables(v, where, alone) for v in below if isinstance(v, Mapping | list))
        return next((rig for rig in rigs if rig is not None and len(rig.cameras) > 1), None)
    if len(tables) > _LIMIT:
        return None
    posed = len(tables) > 1
    wheres = [f"{where}, camera {name or i}" for i, (name, _) in enumerate(tables, 1)]
    placed = [not posed or _pose(_known(t), w) is not None for (_, t), w in zip(tables, wheres)]
    between = _known(tree) if isinstance(tree, Mapping) else {}
    if len(tables) == 2 and not any(placed) and {"rotation", "translation"} <= between.keys():
        poses = (
            {"R": np.eye(3), "T": np.zeros(3)},
            {"R": between["rotation"], "T": between["translation"]},
        )
        tables = [(name, {**table, **pose}) for (name, table), pose in zip(tables, poses)]
        placed = [True, True]
    if not any(placed):
        placed = [True] * len(tables)  # which camera_of refuses, and says what it expects
    cameras = tuple(
        camera_of(table, name, wheres[i], posed)
        for i, (name, table) in enumerate(tables)
        if placed[i]
    )
    unposed = tuple(name or f"{i + 1}" for i, (name, _) in enumerate(tables) if not placed[i])
    family = "stereo pair as OpenCV calibrates it" if pair else "one table per camera"
    rig = ImportedRig(family, cameras, unposed=unposed)
    return _in_unit(rig, tree, where) if isinstance(tree, Mapping) else rig


def _in_unit(rig: ImportedRig, tree: Mapping[str, Any], where: str) -> ImportedRig:
    said = _known(tree).get("unit")
    return rig if said is None else replace(rig, unit_m=metres_in(said, f"{where}: unit"))


def _tables(
    tree: Mapping[str, Any] | list[Any], alone: str
) -> list[tuple[str | None, Mapping[str, Any]]]:
    """Return a table for each camera, with its name as far as there is one."""
    if isinstance(tree, list):
        return [
            (_name(t, None), _flat(t)) for t in tree if isinstance(t, Mapping) and _is_camera(t)
        ]
    if _is_camera(tree):
        stacked = _unstacked(tree)
        return stacked or [(_name(tree, alone), tree)]
    tables = [
        (_name(t, str(key)), _flat(t))
        for key, t in tree.items()
        if isinstance(t, Mapping) and _is_camera(t)
    ]
    return tables or _grouped(tree)


def _flat(table: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a camera's table with what stands in its tables of the lens and of the pose."""
    inner = {
        key: value
        for key, value in table.items()
        if MEANS.get(plain_word(key)) in ("matrix", "pose")
        and isinstance(value, Mapping)
        and "data" not in value
    }
    outer = {key: value for key, value in table.items() if key not in inner}
    return {**outer, **{key: v for part in inner.values() for key, v in part.items()}}


def _is_camera(table: Mapping[str, Any]) -> bool:
    known = _known(table)
    return "matrix" in known or {"fx", "fy"} <= known.keys()


def _name(table: Mapping[str, Any], otherwise: str | None) -> str | None:
    known = _known(table).get("name")
    return known if isinstance(known, str) and known else otherwise


def _unstacked(tree: Mapping[str, Any]) -> list[tuple[str | None, Mapping[str, Any]]]:
    """Return tables from arrays that have one row a camera; none where the file is of one camera."""
    known = _known(tree)
    matrix = np.asarray(known.get("matrix"), dtype=object)
    if matrix.ndim != 3 or len(matrix) > _LIMIT:
        return []
    count = len(matrix)
    names = next(
        (v for key, v in tree.items() if plain_word(key) in ("names", "cameranames", "cameras")),
        None,
    )
    if names is not None and len(names) != count:
        names = None

    def row(field: str, value: Any, i: int) -> Any:
        values = np.asarray(value, dtype=object)
        if (
            field in ("matrix", "distortions", "rotation", "translation", "pose", "inverse")
            or values.ndim == 2
        ):
            return value[i] if len(value) == count else value
        return value

    own = {field: v for field, v in known.items() if field not in ("name", "unit")}
    key = {field: _NAMES[field].split()[0] for field in own}
    return [
        (None if names is None else str(names[i]), {key[f]: row(f, v, i) for f, v in own.items()})
        for i in range(count)
    ]


def _grouped(tree: Mapping[str, Any]) -> list[tuple[str | None, Mapping[str, Any]]]:
    """Return tables from keys such as K_cam0, cam0_K, K0 or cam0/K."""
    groups: dict[str, dict[str, Any]] = {}
    for key, value in tree.items():
        for first, last in _splits(str(key)):
            for field, name in ((first, last), (last, first)):
                if plain_word(field) in MEANS and name:
                    groups.setdefault(name, {}).setdefault(field, value)
    return [(name, t) for name, t in groups.items() if _is_camera(t) and len(t) > 1]


def _splits(key: str) -> list[tuple[str, str]]:
    ends = [(key[: m.start()], key[m.end() :]) for m in re.finditer(r"[_./\- ]", key[:80])]
    numbered = re.fullmatch(r"(\D*[A-Za-z])(\d+)", key[:80])
    return [*ends, *([(numbered[1], numbered[2])] if numbered else [])]


def _stereo(tree: Mapping[str, Any]) -> list[tuple[str | None, Mapping[str, Any]]]:
    """Return the lenses of a stereo calibration, which has the second camera's pose from the first beside them; else none."""
    pair: dict[str, dict[str, Any]] = {"1": {}, "2": {}}
    for key, value in tree.items():
        match = _STEREO.match(str(key))
        if match and MEANS.get(plain_word(match[1])) in ("matrix", "distortions", "size"):
            which = "1" if match[2].lower() in ("1", "left", "l") else "2"
            pair[which].setdefault(match[1], value)
    known = _known(tree)
    if not all(map(_is_camera, pair.values())) or not {"rotation", "translation"} <= known.keys():
        return []
    shared = {k: known[k] for k in ("size", "width", "height", "model", "fisheye") if k in known}
    return [(None, {**shared, **own}) for own in pair.values()]


def camera_of(
    table: Mapping[str, Any], name: str | None, where: str, posed: bool
) -> ImportedCamera:
    """Return the camera of a table. posed: whether it must say where it stands. Raises HandtrackError."""
    known = _known(table)
    said = [
        str(known[field]) for field in ("model", "fisheye") if known.get(field) not in (None, "")
    ]
    models = [is_fisheye(word if word != "0" else "", where) for word in said]
    if "distortions" not in known:
        raise HandtrackError(
            f"{where}: no distortion coefficients, only {', '.join(map(str, table))}; expected `dist` (k1 k2 p1 p2 k3), or zeros "
            "where the images have none."
        )
    distortions = numbers(known["distortions"], f"{where}, distortion").ravel()
    if known.get("xi"):
        raise _mirror(where)
    pose = _pose(known, where)
    if posed and pose is None:
        raise HandtrackError(
            f"{where}: no pose, only {', '.join(map(str, table))}; expected `R` (matrix or rotation vector) and `t`, world to "
            "camera: p_camera = R p_world + t."
        )
    lens_open = len(distortions) == FISHEYE_COUNT and bool(distortions.any()) and not said
    matrix = _matrix(known, where)
    if min(matrix[0, 0], matrix[1, 1]) < _LEAST_FOCAL_PX:
        raise HandtrackError(
            f"{where}: focal lengths of {matrix[0, 0]:g} and {matrix[1, 1]:g}; expected pixels. Are they in millimetres, or "
            "shares of the image's width?"
        )
    return ImportedCamera(
        name,
        _size(known, where, matrix),
        matrix,
        distortions,
        *(pose or (np.eye(3), np.zeros(3))),
        None if lens_open else any(models),
    )


def _mirror(where: str) -> HandtrackError:
    return HandtrackError(
        f"{where}: `xi` is of an omnidirectional lens (Mei's), which is not read; undistort its images to a pinhole's."
    )


def _matrix(known: Mapping[str, Any], where: str) -> Floats[D3, D3]:
    apart = [known.get(name) for name in _FOCAL_AND_CENTRE]
    value = numbers(known.get("matrix", apart), f"{where}, matrix or fx fy cx cy")
    if value.shape == (4,):
        return camera_matrix(*value.tolist())
    return numbers(value, f"{where}, matrix", (3, 3))


def _size(known: Mapping[str, Any], where: str, matrix: Floats[D3, D3]) -> tuple[int, int] | None:
    if "size" in known:  # some write height, width: the axis goes through the image's middle
        size = whole_size(numbers(known["size"], f"{where}, size").ravel()[:2], f"{where}, size")
        off, turned = (np.abs(matrix[:2, 2] / shape - 0.5).max() for shape in (size, size[::-1]))
        return size if turned > off / 2 or off < _MIDDLE else (size[1], size[0])
    if {"width", "height"} <= known.keys():
        return whole_size([known["width"], known["height"]], f"{where}, width and height")
    return None


def _pose(known: Mapping[str, Any], where: str) -> tuple[Floats[D3, D3], Floats[D3]] | None:
    """Return where a table says its camera stands; null, as for one that was not found, says nothing."""
    whole = known.get("pose", known.get("inverse"))
    if {"rotation", "translation"} <= known.keys():
        moved = numbers(known["translation"], f"{where}, translation", (3,))
        return rotation_of(known["rotation"], f"{where}, rotation"), moved
    if whole is not None:
        pose = numbers(whole, f"{where}, pose", (3, 4), (4, 4))
        turned, moved = pose[:3, :3], pose[:3, 3]
        return (turned, moved) if "pose" in known else (turned.T, -turned.T @ moved)
    return _rectified(known, where)


def _rectified(known: Mapping[str, Any], where: str) -> tuple[Floats[D3, D3], Floats[D3]] | None:
    """Return the pose from a ROS camera_info, in the rectified frame that its pair shares; None where it says none.

    `p_rectified = R p_camera`, and P = [K' | K' (b, 0, 0)] has the baseline b to the first camera.
    """
    turn = known.get("rectification", known.get("rotation"))
    if turn is None or "projection" not in known:
        return None
    turned = rotation_of(turn, f"{where}, R")
    projected = numbers(known["projection"], f"{where}, P").ravel()
    if len(projected) != 12 or projected[[1, 4, 7, 8, 9, 11]].any() or projected[10] != 1:
        return None
    moved = np.array([projected[3] / projected[0], 0.0, 0.0])
    return None if not moved.any() and (turned == np.eye(3)).all() else (turned.T, turned.T @ moved)


def _known(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a table says by our names; of two keys that mean the same the first counts."""
    known: dict[str, Any] = {}
    for key, value in table.items():
        field = MEANS.get(plain_word(key))
        missing = value is None or (isinstance(value, str) and value == "null")
        if field is not None and not missing:
            known.setdefault(field, value)
    return known
