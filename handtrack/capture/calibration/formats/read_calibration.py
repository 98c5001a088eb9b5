"""Anybody's calibration: the table of the forms that are read, tried by content, in one place."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.capture.calibration.formats.calibration_tree import Tree, calibration_tree
from handtrack.capture.calibration.formats.camera_tables import (
    read_nerf,
    read_splatting,
    read_tables,
)
from handtrack.capture.calibration.formats.colmap import colmap_folder, read_colmap
from handtrack.capture.calibration.formats.given_rig import GivenCamera, GivenRig
from handtrack.capture.calibration.formats.kalibr import read_kalibr
from handtrack.capture.calibration.formats.matlab import read_bouguet, read_matlab
from handtrack.capture.calibration.formats.qualisys import read_qualisys
from handtrack.errors import HandtrackError

ACCEPTED = (
    "TOML of Anipose, Pose2Sim, FreeMoCap and Caliscope; OpenCV's YAML, XML and JSON (a stereo pair, or a file a camera); "
    "Kalibr's camchain YAML; a COLMAP model (folder, text or binary); MATLAB's stereoParameters (.mat or JSON) "
    "and Bouguet's Calib_Results_stereo.mat; Qualisys XML; handpose3d's c0.dat with rot_trans_c0.dat; cameras.json of Gaussian "
    "splatting; NeRF's transforms.json; a pair of ROS camera_info; EasyMocap's intri.yml with extri.yml; JSON, YAML or NPZ with K, dist, R and t of each camera"
)
CONVERT = (
    'To convert another one, write JSON: {"cam0": {"K": 3x3, "dist": [k1, k2, p1, p2, k3], "R": 3x3, "t": [x, y, z], "size": '
    "[w, h]}, …}, with p_camera = R p_world + t."
)


def _tables(path: Path, tree: Any) -> GivenRig | None:
    return read_tables(tree, str(path), path.stem) if isinstance(tree, Mapping | list) else None


FORMS: tuple[tuple[tuple[str, ...], Callable[[Path, Any], GivenRig | None]], ...] = (
    (("yaml",), lambda path, tree: read_kalibr(tree, str(path))),
    (("mat", "json"), lambda path, tree: read_matlab(tree, str(path))),
    (("mat",), lambda path, tree: read_bouguet(tree, str(path))),
    (("json",), lambda path, tree: read_splatting(tree, str(path)) or read_nerf(tree, str(path))),
    (("xml",), lambda path, tree: read_qualisys(tree, str(path))),
    (("toml", "yaml", "json", "xml", "npz", "mat", "rows"), _tables),
)
"""what a file may be written in, and who may know it; the first that does reads it"""


def read_calibration(paths: Sequence[Path]) -> GivenRig:
    """Return the cameras of one file or folder, or of several files: one a camera, or parts of one.

    Raises HandtrackError; for what is of no known form, with all that are, and how to convert.
    """
    if len(paths) == 1:
        return _one(paths[0])
    trees = {path: _by_camera(calibration_tree(path), path) for path in paths}
    single = [_single(path, tree) for path, tree in trees.items()]
    cameras = tuple(camera for camera in single if camera is not None)
    if len(cameras) == len(paths):
        return GivenRig("one file a camera", _posed(cameras, paths))
    merged: dict[str, Any] = {}
    for path, tree in trees.items():
        if tree is None or not isinstance(tree.content, Mapping):
            raise _unknown(path)
        for key, value in tree.content.items():  # a camera's table may stand in each
            known = merged.get(str(key))
            if isinstance(known, Mapping) and isinstance(value, Mapping):
                value = {**known, **value}
            merged[str(key)] = value
    rig = read_tables(merged, " and ".join(map(str, paths)), paths[0].stem)
    if rig is None or len(rig.cameras) < 2:
        raise _half(merged, " and ".join(map(str, paths))) or _unknown(paths[0])
    return rig


def _by_camera(tree: Tree | None, path: Path) -> Tree | None:
    """Return a file of rows with its camera in its keys: handpose3d's c0.dat and rot_trans_c0.dat are of `c0`."""
    camera = re.search(r"[A-Za-z]+\d+$", path.stem)
    if tree is None or tree.form != "rows" or camera is None:
        return tree
    return Tree("rows", {f"{key}_{camera[0]}": rows for key, rows in tree.content.items()})


def _one(path: Path) -> GivenRig:
    folder = colmap_folder(path)
    if folder is not None:
        return read_colmap(folder)
    if path.is_dir():
        rows = sorted(path.glob("*.dat"))
        if rows:
            return read_calibration(rows)
        raise HandtrackError(
            f"{path} is a folder without a COLMAP model; expected a calibration. Accepted: {ACCEPTED}."
        )
    tree = calibration_tree(path)
    for forms, read in FORMS if tree is not None else ():
        rig = read(path, tree.content) if tree is not None and tree.form in forms else None
        if rig is not None:
            _check_names(rig, path)
            return rig
    content = None if tree is None else tree.content
    raise _half(content, str(path)) or _unknown(path, content)


def _single(path: Path, tree: Tree | None) -> GivenCamera | None:
    """Return the camera of a file that has one alone, named by the file where it does not say a name."""
    content = None if tree is None else tree.content
    if not isinstance(content, Mapping):
        raise _unknown(path)
    try:
        rig = read_tables(content, str(path), path.stem)
    except HandtrackError:
        return None
    return rig.cameras[0] if rig is not None and len(rig.cameras) == 1 else None


def _posed(cameras: tuple[GivenCamera, ...], paths: Sequence[Path]) -> tuple[GivenCamera, ...]:
    at_origin = [c for c in cameras if not c.translation.any() and (c.rotation == np.eye(3)).all()]
    if len(at_origin) > 1:
        raise HandtrackError(
            f"{paths[0]}: {len(at_origin)} of {len(cameras)} cameras have no pose (R and t, world to camera), so where they stand "
            "is not known. Add it to each file, or give the stereo calibration (R, T) as well."
        )
    names = [camera.name for camera in cameras]
    if len(set(names)) < len(names):  # all say the same, such as "camera"
        cameras = tuple(replace(c, name=path.stem) for c, path in zip(cameras, paths, strict=True))
    return cameras


def _check_names(rig: GivenRig, path: Path) -> None:
    names = [camera.name for camera in rig.cameras if camera.name is not None]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise HandtrackError(f"{path}: two cameras have the name '{twice}'; expected one each.")


def _half(content: Any, where: str) -> HandtrackError | None:
    """Return what to say of a file that holds lenses or poses alone; None for one that holds neither."""
    tables = [content, *content.values()] if isinstance(content, Mapping) else []
    keys = [str(key) for table in tables if isinstance(table, Mapping) for key in table]
    plain = {re.sub(r"[\W_\d]|left|right", "", key.lower()) for key in keys}
    lenses = plain & {
        "k",
        "m",
        "cameramatrix",
        "mtx",
        "intrinsic",
        "intrinsics",
        "matrix",
        "d",
        "dist",
        "distcoeffs",
    }
    poses = plain & {
        "r",
        "t",
        "rot",
        "trans",
        "rvec",
        "tvec",
        "rotation",
        "translation",
        "extrinsics",
        "rt",
        "tcni",
    }
    if bool(lenses) == bool(poses):
        return None
    here, missing = (
        ("the poses", "the lenses (K, dist)") if poses else ("the lenses", "the poses (R, t)")
    )
    return HandtrackError(
        f"{where}: only {here} of a calibration ({', '.join(keys[:6])}); {missing} are missing. Give both files: "
        "--calibration INTRINSICS EXTRINSICS."
    )


def _unknown(path: Path, content: Any = None) -> HandtrackError:
    if isinstance(content, Mapping) and content:
        keys = ", ".join(map(str, list(content)[:8]))
        return HandtrackError(
            f"{path}: neither a camera matrix nor a pose under a name that is known; its keys: {keys}. {CONVERT}"
        )
    return HandtrackError(
        f"{path}: no calibration that is known here. Accepted: {ACCEPTED}. {CONVERT}"
    )
