"""Anybody's calibration: the table of the forms that are read, tried by content, in one place."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from handtrack.capture.calibration.formats.camera_tables import MEANS, read_tables
from handtrack.capture.calibration.formats.imported_rig import ImportedCamera, ImportedRig
from handtrack.capture.calibration.formats.programs import (
    colmap_folder,
    read_bouguet,
    read_colmap,
    read_kalibr,
    read_matlab,
    read_nerf,
    read_qualisys,
    read_splatting,
)
from handtrack.errors import HandtrackError
from handtrack.files.mat_files import read_mat, read_mat_objects
from handtrack.files.npz_files import read_arrays
from handtrack.files.text_files import (
    MOST_BYTES,
    check_file,
    first_bytes,
    read_json,
    read_text,
    read_xml,
)
from handtrack.files.toml_table import read_toml
from handtrack.files.yaml_text import parse_yaml

_WHAT = "a calibration"
_TOML = re.compile(r"\[+\s*[\w.\"'-]+\s*\]+\s*(#.*)?$|[\w.\"'-]+\s*=")
_YAML = re.compile(r"""(- |[\w."'/ -]+:(\s|$)|\{)""")
_ROWS = re.compile(r"(?:#.*\r?\n)*[A-Za-z]+:[ \t]*\r?\n[ \t]*[-+.\d]+[eE\d.+-]*[ \t]+[-+.\d]")
_STORAGE = "opencv_storage"

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


_Read = Callable[[Any, str], ImportedRig | None]
FORMS: tuple[tuple[tuple[str, ...], _Read], ...] = (
    (("yaml",), read_kalibr),
    (("mat", "json"), read_matlab),
    (("mat",), read_bouguet),
    (("json",), read_splatting),
    (("json",), read_nerf),
    (("xml",), read_qualisys),
)
"""what a file may be written in, and which program's it may be; the first that knows it reads it, else it is read as tables"""


def read_calibration(paths: Sequence[Path]) -> ImportedRig:
    """Return the cameras of one file or folder, or of several files: one a camera, or parts of one.

    Raises HandtrackError; for what is of no known form, with all that are, and how to convert.
    """
    if len(paths) == 1:
        return _one(paths[0])
    contents = {path: _by_camera(path) for path in paths}
    single = [_single(path, content) for path, content in contents.items()]
    cameras = tuple(camera for camera in single if camera is not None)
    if len(cameras) == len(paths):
        return ImportedRig("one file per camera", _posed(cameras, paths))
    merged: dict[str, Any] = {}
    for content in contents.values():
        for key, value in content.items():  # a camera's table may stand in each
            known = merged.get(str(key))
            if isinstance(known, Mapping) and isinstance(value, Mapping):
                value = {**known, **value}
            merged[str(key)] = value
    rig = read_tables(merged, " and ".join(map(str, paths)), paths[0].stem)
    if rig is None or len(rig.cameras) < 2:
        raise _half(merged, " and ".join(map(str, paths))) or _unknown(paths[0])
    return rig


def _by_camera(path: Path) -> Mapping[str, Any]:
    """Return the tables of a file; of rows with the camera in their keys: handpose3d's c0.dat and rot_trans_c0.dat are of `c0`."""
    form, content = _content(path)
    if not isinstance(content, Mapping):
        raise _unknown(path)
    camera = re.search(r"[A-Za-z]+\d+$", path.stem)
    if form != "rows" or camera is None:
        return content
    return {f"{key}_{camera[0]}": rows for key, rows in content.items()}


def _one(path: Path) -> ImportedRig:
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
    form, content = _content(path)
    readers = [read for forms, read in FORMS if form in forms]
    rig = next((rig for read in readers if (rig := read(content, str(path)))), None)
    if rig is None and isinstance(content, Mapping | list):
        rig = read_tables(content, str(path), path.stem)
    if rig is None:
        raise _half(content, str(path)) or _unknown(path, content)
    names = [camera.name for camera in rig.cameras if camera.name is not None]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise HandtrackError(f"{path}: two cameras have the name '{twice}'; expected one each.")
    return rig


def _single(path: Path, content: Mapping[str, Any]) -> ImportedCamera | None:
    """Return the camera of a file that has one alone, named by the file where it does not say a name."""
    try:
        rig = read_tables(content, str(path), path.stem)
    except HandtrackError:
        return None
    return rig.cameras[0] if rig is not None and len(rig.cameras) == 1 else None


def _posed(
    cameras: tuple[ImportedCamera, ...], paths: Sequence[Path]
) -> tuple[ImportedCamera, ...]:
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


def _half(content: Any, where: str) -> HandtrackError | None:
    """Return what to say of a file that holds lenses or poses alone; None for one that holds neither."""
    tables = [content, *content.values()] if isinstance(content, Mapping) else []
    keys = [str(key) for table in tables if isinstance(table, Mapping) for key in table]
    said = {MEANS.get(re.sub(r"[\W_\d]|left|right", "", key.lower())) for key in keys}
    lenses = said & {"matrix", "distortions"}
    poses = said & {"rotation", "translation", "pose"}
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


# ---- what a file holds, as nested tables, whatever it was written in: chosen by its first bytes, never by its name


def _content(path: Path) -> tuple[str, Any]:
    """Return a file's form (toml, yaml, json, xml, npz, mat or rows) and what it holds: nested dict and list, of other XML than
    OpenCV's the root element; nothing where it is of no known form. Raises HandtrackError for what cannot be read.
    """
    check_file(path, _WHAT)
    start = first_bytes(path)
    if start[:4] == b"PK\3\4":
        arrays = read_arrays(path).items()  # without pickles
        return "npz", {
            k: a if a.ndim and a.dtype.kind not in "US" else a.tolist() for k, a in arrays
        }
    if start[:10] == b"MATLAB 5.0":
        variables = read_mat(path)
        return "mat", read_mat_objects(path) if _holds_object(variables) else variables
    if start[:10] == b"MATLAB 7.3":
        return "mat", read_mat_objects(path)
    if start[:1] == b"\x80" and start[1:2] in b"\2\3\4\5":
        raise HandtrackError(
            f"{path} is a Python pickle, which may run any program when it is read, so it is not. Where you trust it, write it "
            "as JSON: for each camera K, dist, R, t and size, as lists (OpenCap's: intrinsicMat, distortion, rotation, "
            "translation in mm, imageSize as height, width)."
        )
    if b"\0" in start:
        return "", None
    text = start.decode("utf-8-sig", errors="replace").lstrip()
    if text.startswith("<"):
        root = read_xml(path, _WHAT)
        return "xml", _storage(root, 0, path) if root.tag == _STORAGE else root
    if text.startswith("{") or re.match(r"\[\s*\{", text):
        return "json", read_json(path, _WHAT)
    if text.startswith(("%YAML", "---")):
        return _yaml(path)
    first = next(
        (line for line in text.splitlines() if line.strip() and line.strip()[0] != "#"), ""
    )
    if _TOML.match(first.strip()):
        return "toml", read_toml(path, _WHAT)
    if _ROWS.match(text):
        return "rows", _rows(path)
    return _yaml(path) if _YAML.match(first.strip()) else ("", None)


def _holds_object(value: Any) -> bool:
    """Return whether something that `read_mat` returned has an object of a class in it, which it gives as None."""
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return value is None or any(map(_holds_object, inner))


def _rows(path: Path) -> dict[str, list[list[float]]]:
    """Return what stands below each `word:`, rows of numbers, as handpose3d writes a camera's lens and its pose."""
    found: dict[str, list[list[float]]] = {}
    key = ""
    for line in read_text(path, _WHAT).splitlines():
        if line.strip().endswith(":"):
            key = line.strip()[:-1]
            found[key] = []
        elif key and line.strip() and line.strip()[0] != "#":
            try:
                found[key].append([float(word) for word in line.split(None, MOST_BYTES)])
            except ValueError:
                raise HandtrackError(f"{path}: '{line[:60]}'; expected a row of numbers.") from None
    return found


def _yaml(path: Path) -> tuple[str, Any]:
    try:
        return "yaml", parse_yaml(read_text(path, _WHAT))
    except ValueError as error:
        raise HandtrackError(f"{path}: not readable YAML: {error}.") from None


def _storage(element: ElementTree.Element, depth: int, path: Path) -> Any:
    """Return what OpenCV wrote: elements named `_` are a list, a text of numbers is one or several."""
    if depth > 40:
        raise HandtrackError(f"{path}: nested more than 40 times; no calibration is.")
    children = list(element)
    if children and all(child.tag == "_" for child in children):
        return [_storage(child, depth + 1, path) for child in children]
    if children:
        return {child.tag: _storage(child, depth + 1, path) for child in children}
    text = (element.text or "").strip()
    if text[:1] == '"':
        return text.strip('"')
    words = text.split(None, MOST_BYTES)
    try:
        values = [int(w) if re.fullmatch(r"[-+]?\d{1,15}", w) else float(w) for w in words]
    except ValueError:
        return text
    return values[0] if len(values) == 1 and element.tag != "data" else values
