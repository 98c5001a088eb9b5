"""Calibrations in forms of single programs: Kalibr, MATLAB, Bouguet's toolbox, Qualisys, Gaussian splatting, NeRF and COLMAP.

Each reader takes what a file holds and its name for messages, writes every camera by the names that `camera_of` reads, and returns None for
what is not of its program. All raise HandtrackError.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO
from xml.etree.ElementTree import Element

import numpy as np

from handtrack.arrays import Floats
from handtrack.capture.calibration.formats.imported_rig import (
    ImportedCamera,
    ImportedRig,
    camera_of,
    is_fisheye,
    numbers,
    numbers_at,
    rotation_of,
    whole_size,
)
from handtrack.errors import HandtrackError
from handtrack.files.text_files import check_file, metres_in
from handtrack.geometry.camera import camera_matrix
from handtrack.geometry.rotation import matrix_from_quaternion

_MOST = 64  # images: a rig has one a camera


def read_kalibr(tree: Any, where: str) -> ImportedRig | None:
    """Return the cameras of a camera chain (YAML): each one's pose is from the one before, in metres."""
    pose, cameras = np.eye(4), list[ImportedCamera]()
    tables = tree.items() if isinstance(tree, Mapping) else ()
    # sorted as text, as some versions write them, cam10 stands before cam2
    for name, table in sorted(tables, key=lambda item: int(re.sub(r"\D", "", str(item[0])) or 0)):
        if not isinstance(table, Mapping) or not {"distortion_model", "intrinsics"} <= table.keys():
            continue
        place = f"{where}, {name}"
        if cameras and "T_cn_cnm1" not in table:
            raise HandtrackError(
                f"{place}: `T_cn_cnm1` is missing, its pose from the camera before; calibrate all together."
            )
        if cameras:
            pose = numbers_at(table, "T_cn_cnm1", place, (4, 4)) @ pose
        lens = numbers_at(table, "intrinsics", place).ravel()
        model = str(table.get("camera_model", "pinhole"))
        if model == "omni" and len(lens) == 5 and lens[0] == 0:  # a mirror that is none
            lens = lens[1:]
        else:
            is_fisheye(model, place)  # raises: of no model that is read
        own = {"matrix": lens, "distortions": table.get("distortion_coeffs") or [], "pose": pose}
        own["model"] = table["distortion_model"]
        if "resolution" in table:
            own["size"] = table["resolution"]
        cameras.append(camera_of(own, str(name), place, True))
    return ImportedRig("Kalibr's camera chain", tuple(cameras), 1.0) if cameras else None


# ---- MATLAB

_MARK = "CameraParameters1"
_MIDDLE = 0.2  # of the image: how far from its middle a lens's axis may be
_HOW = "In MATLAB: s = toStruct(stereoParams); save('stereo.mat', 's', '-v7'), or write jsonencode(s) to a .json file."


def read_matlab(tree: Any, where: str) -> ImportedRig | None:
    """Return the two cameras of stereoParameters, as an object, as a struct or as JSON.

    Vectors stand in rows, and the first pixel is (1, 1).
    """
    table = _table_with(tree, _MARK)
    if table is None and _table_with(tree, "RadialDistortion") is not None:
        raise HandtrackError(
            f"{where}: the lens of one camera, without the cameras' places. Give stereoParams, which stereoCameraCalibrator saves."
        )
    if table is None:
        return None
    parts: dict[str, Any] = {name: table.get(name) for name in (_MARK, "CameraParameters2")}
    if not all(isinstance(part, Mapping) for part in parts.values()):
        raise HandtrackError(f"{where}: CameraParameters1 and 2 must be structs. {_HOW}")
    cameras = tuple(
        camera_of(_matlab_lens(part, f"{where}, {name}") | pose, None, f"{where}, {name}", False)
        for (name, part), pose in zip(parts.items(), ({}, _matlab_pose(table, where)), strict=True)
    )
    said = str(parts[_MARK].get("WorldUnits") or table.get("WorldUnits") or "mm")
    return ImportedRig(
        "MATLAB's stereoParameters", cameras, metres_in(said, f"{where}: WorldUnits")
    )


def _table_with(tree: Any, mark: str) -> Mapping[str, Any] | None:
    """Return the first table with a key, at most three levels down: calibrationSession.mat has it below its session."""
    tables = [tree] if isinstance(tree, Mapping) else []
    for _ in range(4):
        for table in tables:
            if mark in table:
                return table
        tables = [v for table in tables for v in table.values() if isinstance(v, Mapping)]
    return None


def _matlab_pose(table: Mapping[str, Any], where: str) -> dict[str, Any]:
    if {"RotationOfCamera2", "TranslationOfCamera2"} <= table.keys():  # x₂ = x₁ R + t, with rows
        rotation = numbers_at(table, "RotationOfCamera2", where, (3, 3)).T
        return {"rotation": rotation, "translation": table["TranslationOfCamera2"]}
    pose = table.get("PoseCamera2")
    if isinstance(pose, Mapping) and {"R", "Translation"} <= pose.keys():  # rigidtform3d: columns
        return {"rotation": pose["R"], "translation": pose["Translation"]}
    if isinstance(pose, Mapping) and "A" in pose:
        return {"pose": pose["A"]}
    raise HandtrackError(
        f"{where}: neither RotationOfCamera2 with TranslationOfCamera2, nor PoseCamera2 as a struct (R, Translation). {_HOW}"
    )


def _matlab_lens(part: Mapping[str, Any], where: str) -> dict[str, Any]:
    radial, tangential = (
        numbers_at(part, f"{kind}Distortion", where).ravel() for kind in ("Radial", "Tangential")
    )
    if len(radial) > 3 or len(tangential) > 2:
        raise HandtrackError(
            f"{where}: {len(radial)} radial coefficients; expected 2 or 3, and 2 tangential."
        )
    bent = np.zeros(5)
    bent[[0, 1, 4][: len(radial)]] = radial
    bent[2 : 2 + len(tangential)] = tangential
    size = zip(("height", "width"), numbers_at(part, "ImageSize", where).ravel())
    inner = part.get("Intrinsics")
    table = {**inner, **part} if isinstance(inner, Mapping) else part
    if "K" in table:
        matrix = numbers_at(table, "K", where, (3, 3))
    elif "IntrinsicMatrix" in table:
        matrix = numbers_at(table, "IntrinsicMatrix", where, (3, 3)).T
        if np.abs(matrix[2, :2]).max() > 0 and np.abs(matrix[:2, 2]).max() == 0:  # turned on export
            matrix = matrix.T
    elif "FocalLength" in table and "PrincipalPoint" in table:
        lengths = [numbers_at(table, key, where, (2,)) for key in ("FocalLength", "PrincipalPoint")]
        matrix = camera_matrix(*np.concatenate(lengths).tolist())
    else:
        raise HandtrackError(f"{where}: neither K, nor IntrinsicMatrix, nor FocalLength. {_HOW}")
    from_zero = matrix - [[0, 0, 1], [0, 0, 1], [0, 0, 0]]
    return {"matrix": from_zero, "distortions": bent, **dict(size)}


def read_bouguet(tree: Any, where: str) -> ImportedRig | None:
    """Return the two cameras of Bouguet's toolbox (Calib_Results_stereo.mat), whose first pixel is (0, 0)."""
    if not isinstance(tree, Mapping) or not any(key.startswith("fc") for key in tree):
        return None
    if not {"fc_left", "fc_right", "R", "T"} <= tree.keys():
        raise HandtrackError(
            f"{where}: a lens of Bouguet's toolbox, without the cameras' places. Give Calib_Results_stereo.mat, which "
            "stereo_gui saves."
        )
    size = [numbers_at(tree, key, where, (1,)).item() for key in ("nx", "ny") if key in tree]
    cameras = []
    for side, pose in (("left", {}), ("right", {"rotation": tree["R"], "translation": tree["T"]})):
        focal, centre = (numbers_at(tree, f"{n}_{side}", where, (2,)) for n in ("fc", "cc"))
        matrix = camera_matrix(*focal.tolist(), *centre.tolist())
        if f"alpha_c_{side}" in tree:
            matrix[0, 1] = focal[0] * numbers_at(tree, f"alpha_c_{side}", where, (1,)).item()
        lens = {"matrix": matrix, "distortions": tree.get(f"kc_{side}", [])}
        if len(size) == 2 and np.abs(centre / size - 0.5).max() < _MIDDLE:
            lens["size"] = size  # it is one camera's, and the other may be larger
        cameras.append(camera_of(lens | pose, None, f"{where}, {side} camera", False))
    return ImportedRig("Bouguet's stereo calibration", tuple(cameras))


# ---- Qualisys

_PER_PIXEL = 64.0
_MAY_LACK = ("skew", "radialDistortion3", "viewrotation")  # and are 0 then
_TO_OPENCV = np.diag([1.0, -1.0, -1.0])  # their cameras look along −z, y up


def read_qualisys(root: Any, where: str) -> ImportedRig | None:
    """Return the calibrated cameras of Qualisys Track Manager (XML, also as .qca.txt), named by serial number.

    In millimetres, lengths in the image in 64ths of a pixel.
    """
    if not isinstance(root, Element):
        return None
    cameras = tuple(
        _qualisys_camera(e, f"{where}, camera {e.get('serial')}")
        for e in root.iter("camera")
        if e.find("intrinsic") is not None
        and e.find("transform") is not None
        and e.get("calibrated", "true").lower() != "false"
    )
    return ImportedRig("Qualisys calibration", cameras, 1e-3) if cameras else None


def _qualisys_camera(element: Element, where: str) -> ImportedCamera:
    if _attributes(element, "viewrotation", where)[0] % 360:
        raise HandtrackError(
            f"{where}: its view is turned by {element.get('viewrotation')}°, its calibration is not. Set the view rotation to "
            "0 in QTM, and export video and calibration again."
        )
    intrinsic, transform, field = (element.find(n) for n in ("intrinsic", "transform", "fov_video"))
    lens = _attributes(intrinsic, "focalLengthU focalLengthV centerPointU centerPointV skew", where)
    fx, fy, cx, cy, skew = lens / _PER_PIXEL
    bent = _attributes(
        intrinsic,
        "radialDistortion1 radialDistortion2 tangentalDistortion1 tangentalDistortion2 radialDistortion3",
        where,
    )
    if field is not None:
        left, top, right, bottom = _attributes(field, "left top right bottom", where)
        size = round(right - left) + 1, round(bottom - top) + 1
    else:
        left = top = 0.0
        most = _attributes(intrinsic, "sensorMaxU sensorMaxV", where)
        size = math.ceil((most[0] + 1) / _PER_PIXEL), math.ceil((most[1] + 1) / _PER_PIXEL)
    matrix = camera_matrix(fx, fy, cx - left, cy - top)
    matrix[0, 1] = skew
    turned = _attributes(transform, "r11 r12 r13 r21 r22 r23 r31 r32 r33", where).reshape(3, 3)
    rotation = _TO_OPENCV @ turned
    pose = {"rotation": rotation, "translation": -rotation @ _attributes(transform, "x y z", where)}
    own = {"matrix": matrix, "distortions": bent, "size": size}
    return camera_of(own | pose, element.get("serial") or None, where, True)


def _attributes(element: Element | None, keys: str, where: str) -> Floats:
    assert element is not None
    texts = [element.get(key, "0" if key in _MAY_LACK else "") for key in keys.split()]
    return numbers(texts, f"{where}, {element.tag} {keys}")


# ---- an image a camera


def read_splatting(tree: Any, where: str) -> ImportedRig | None:
    """Return the cameras of Gaussian splatting's cameras.json, an image each.

    Its poses are the cameras' (camera to world), its lenses have no distortion and their axis in the image's middle.
    """
    keys = {"img_name", "width", "height", "position", "rotation", "fx", "fy"}
    if (
        not isinstance(tree, list)
        or not tree
        or not all(isinstance(t, Mapping) and keys <= t.keys() for t in tree)
    ):
        return None
    _check_count(len(tree), where)
    cameras = []
    for table in tree:
        name = str(table["img_name"])
        place = f"{where}, image '{name}'"
        turned = rotation_of(table["rotation"], f"{place}, rotation")
        pose = np.column_stack([turned, numbers_at(table, "position", place, (3,))])
        sides = numbers([table["width"], table["height"]], f"{place}, width and height")
        lens = [table["fx"], table["fy"], *(0.5 * (sides - 1))]
        own = {
            "size": sides,
            "matrix": lens,
            "distortions": np.zeros(5),
            "inverse": pose,
        }
        cameras.append(camera_of(own, name.rsplit(".", 1)[0], place, True))
    return ImportedRig("cameras.json of Gaussian splatting", tuple(cameras), any_unit=True)


def read_nerf(tree: Any, where: str) -> ImportedRig | None:
    """Return the cameras of NeRF's transforms.json (Instant-NGP, Nerfstudio), an image each.

    Its poses are camera to world, of a camera that looks along -z with y up; the first pixel's centre is (0.5, 0.5).
    """
    frames = tree.get("frames") if isinstance(tree, Mapping) else None
    if not isinstance(frames, list) or not all(
        isinstance(f, Mapping) and "transform_matrix" in f for f in frames
    ):
        return None
    _check_count(len(frames), where)
    cameras = []
    for frame in frames:
        table = {**tree, **frame}
        name = str(table.get("file_path", len(cameras)))
        place = f"{where}, image '{name}'"
        pose = numbers_at(table, "transform_matrix", place, (3, 4), (4, 4))[:3]
        width, height = whole_size([table.get("w"), table.get("h")], f"{place}, w and h [px]")
        angle = numbers(table.get("camera_angle_x", 1.0), f"{place}, camera_angle_x", (1,)).item()
        fx = table.get("fl_x", 0.5 * width / math.tan(0.5 * angle))
        middle = table.get("cx", width / 2), table.get("cy", height / 2)
        lens = numbers([fx, table.get("fl_y", fx), *middle], f"{place}, fl_x fl_y cx cy").tolist()
        model = str(table.get("camera_model", ""))
        given = {**table, **dict(zip(("fx", "fy", "cx", "cy"), lens))}
        own = _lens(given, is_fisheye(model, place)) | {"model": model, "size": (width, height)}
        own["inverse"] = pose * [1, -1, -1, 1]
        name = re.sub(r"\.\w+$", "", name.rsplit("/", 1)[-1])
        cameras.append(camera_of(own, name, place, True))
    return ImportedRig("NeRF's transforms.json", tuple(cameras), any_unit=True)


def _check_count(count: int, where: str | Path) -> None:
    if count > _MOST:
        raise HandtrackError(
            f"{where}: more than {_MOST} images; expected one of each camera of a rig that stands still. Keep one image a camera "
            "(in a COLMAP model: `colmap image_deleter`)."
        )


# ---- COLMAP: the first pixel's centre is (0.5, 0.5), and lengths have no unit

_LARGEST = 4 << 30  # bytes of images.*, of which the points are passed over
_MODELS = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "FOV": "fx fy cx cy omega",
    "SIMPLE_RADIAL_FISHEYE": "f cx cy k1",
    "RADIAL_FISHEYE": "f cx cy k1 k2",
    "THIN_PRISM_FISHEYE": "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1",
}
"""parameters, in the order of the models' numbers in binary files"""
_NOT_READ = ("FOV", "THIN_PRISM_FISHEYE")
_Lenses = dict[int, tuple[str, tuple[int, int], tuple[float, ...]]]
"""model, width and height, and parameters by number"""
_Images = list[tuple[str, int, tuple[float, ...]]]
"""name, camera, and qw qx qy qz tx ty tz, world to camera"""


def colmap_folder(path: Path) -> Path | None:
    """Return the folder of a COLMAP model, given it, one above it, or one of its files; None for anything else."""
    if path.is_file():
        stem, suffix = path.stem, path.suffix
        return path.parent if stem in ("cameras", "images") and suffix in (".txt", ".bin") else None
    below = [path, path / "sparse" / "0", path / "sparse", path / "0"]
    return next(
        (f for f in below if any((f / f"cameras{s}").is_file() for s in (".bin", ".txt"))), None
    )


def read_colmap(folder: Path) -> ImportedRig:
    """Return a camera for each image of a model, text or binary."""
    suffix = ".bin" if (folder / "cameras.bin").is_file() else ".txt"
    cameras, images = folder / f"cameras{suffix}", folder / f"images{suffix}"
    for path in (cameras, images):
        check_file(path, f"COLMAP's {path.name}", _LARGEST)
    is_text = suffix == ".txt"
    try:
        lenses = _text_lenses(cameras) if is_text else _binary_lenses(cameras)
        shots = _text_images(images) if is_text else _binary_images(images)
    except (ValueError, IndexError, struct.error, OSError, OverflowError) as error:
        raise HandtrackError(
            f"{folder}: {cameras.name} and {images.name} are not readable as COLMAP writes them ({error}). Export the model again."
        ) from None
    if not shots or not lenses:
        raise HandtrackError(
            f"{folder}: the model has no images with a pose; expected one image of each camera."
        )
    names = _camera_names([name for name, *_ in shots], images)
    rig = []
    for (image, number, pose), name in zip(shots, names, strict=True):
        where = f"{cameras}, camera {number}"
        if number not in lenses:
            raise HandtrackError(f"{cameras}: no camera {number}, which the image '{image}' names.")
        if not np.isfinite(pose).all() or not any(pose[:4]):
            raise HandtrackError(f"{where}: its pose is not of finite numbers.")
        rotation = matrix_from_quaternion(np.array(pose[:4]))
        own = _colmap_lens(*lenses[number], where) | {"rotation": rotation, "translation": pose[4:]}
        rig.append(camera_of(own, name, where, True))
    return ImportedRig("COLMAP model", tuple(rig), any_unit=True)


def _text_rows(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8") as file:
        while line := file.readline(1 << 16):
            if not line.endswith("\n"):
                while len(rest := file.readline(1 << 20)) and not rest.endswith("\n"):
                    pass  # points of a large image
            if not line.startswith("#"):
                yield line


def _text_lenses(path: Path) -> _Lenses:
    lenses: _Lenses = {}
    for line in _text_rows(path):
        if line.strip():
            number, model, width, height, *values = line.split()
            lenses[int(number)] = model, (int(width), int(height)), tuple(map(float, values))
    return lenses


def _text_images(path: Path) -> _Images:
    rows, images = _text_rows(path), list[Any]()
    for line in rows:
        if line.strip():
            _, *pose, camera, name = line.split(maxsplit=9)
            images.append((name.strip(), int(camera), tuple(map(float, pose))))
            _check_count(len(images), path)
            next(rows, None)  # its points
    return images


def _binary_lenses(path: Path) -> _Lenses:
    with path.open("rb") as file:
        (count,) = _take(file, "<Q")
        _check_count(count, path)
        lenses: _Lenses = {}
        for _ in range(count):
            number, model, width, height = _take(file, "<IiQQ")
            if not 0 <= model < len(_MODELS):
                raise ValueError(f"an unknown camera model {model}")
            name = list(_MODELS)[model]
            values = _take(file, f"<{len(_MODELS[name].split())}d")
            lenses[number] = name, (width, height), values
        return lenses


def _binary_images(path: Path) -> _Images:
    with path.open("rb") as file:
        (count,) = _take(file, "<Q")
        _check_count(count, path)
        images = []
        for _ in range(count):
            _, *pose, camera = _take(file, "<I7dI")
            name = b"".join(islice(iter(lambda: file.read(1), b"\0"), 1001))
            if len(name) > 1000:
                raise ValueError("a name without end")
            (points,) = _take(file, "<Q")
            file.seek(24 * points, 1)
            images.append((name.decode(), camera, tuple(pose)))
        return images


def _take(file: BinaryIO, form: str) -> tuple:
    return struct.unpack(form, file.read(struct.calcsize(form)))


def _camera_names(names: list[str], path: Path) -> list[str]:
    """Return the cameras' names: the images' folders where these differ, else their names without ending."""
    paths = [PurePosixPath(name) for name in names]
    for candidate in ([p.parent.name for p in paths], [p.stem for p in paths]):
        if all(candidate) and len(set(candidate)) == len(candidate):
            return candidate
    raise HandtrackError(
        f"{path}: several images of one camera ({', '.join(names[:3])}, …); expected one of each, named as the camera or in a "
        "folder of its name. Keep one image a camera in the model (`colmap image_deleter`)."
    )


def _colmap_lens(
    model: str, size: tuple[int, int], parameters: tuple[float, ...], where: str
) -> dict[str, Any]:
    if model in _NOT_READ or model not in _MODELS:
        is_fisheye(f"{model} (COLMAP)", where)  # raises: of no model that is read
    places = _MODELS[model].split()
    if len(parameters) != len(places):
        raise HandtrackError(
            f"{where}: {len(parameters)} parameters; {model} has {', '.join(places)}."
        )
    given = dict(zip(places, parameters, strict=True))
    lens = _lens(given, model.endswith("FISHEYE"))
    return lens | {"fisheye": model.endswith("FISHEYE"), "size": size}


def _lens(given: Mapping[str, Any], is_fisheye: bool) -> dict[str, Any]:
    """Return a lens by our names from parameters by COLMAP's, the first pixel's centre being (0.5, 0.5)."""
    keys = "k1 k2 k3 k4" if is_fisheye else "k1 k2 p1 p2 k3 k4 k5 k6"
    fx, fy = (given.get(key, given.get("f")) for key in ("fx", "fy"))
    return {
        "matrix": [fx, fy, given["cx"] - 0.5, given["cy"] - 0.5],
        "distortions": [given.get(key, 0.0) for key in keys.split()],
    }
