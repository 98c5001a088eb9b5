"""Cameras as somebody's file gives them: in its own unit of length, perhaps without names or image sizes; and read from tables."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from handtrack.arrays import D3, Array, Axes, Floats, K, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.files.text_files import metres_in
from handtrack.geometry.camera import Camera, CameraRig, camera_matrix
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.geometry.source_lens import FISHEYE_COUNT

_ROUGH = 1e-3  # how far a matrix of four written digits may be from a rotation
_SKEW = 1e-9  # of the focal length: what rounding leaves
_DIGITS = 13  # decimals that are the same whatever the form: 1e-13 rad are 3e-10 px at a focal length of 3000
_MOST_NUMBERS = 64  # in one value of a camera
_IS_FISHEYE = {
    name: fisheye
    for fisheye, names in (
        (
            False,
            ",none,pinhole,perspective,standard,opencv,radtan,radialtangential,plumbbob,brown,brownconrady,"
            "pinholeradtan,rationalpolynomial,rational,regular,linear,fullopencv,simplepinhole,false,no,0",
        ),
        (
            True,
            "fisheye,opencvfisheye,equidistant,equi,pinholeequi,kannalabrandt,kannalabrandt4,kb,kb4,true,yes,1",
        ),
    )
    for name in names.split(",")
}
"""by names of lenses, small and without punctuation: those of OpenCV's polynomial, and of `cv2.fisheye`'s in the angle"""


@array_dataclass
class ImportedCamera:
    """One camera of a file; `p_camera = R p_world + t`."""

    name: str | None
    size: tuple[int, int] | None
    """width, height [px]; None where the file does not say."""
    matrix: Floats[D3, D3]
    """[px], pixel centres at whole numbers from 0."""
    distortions: Floats[K]
    rotation: Floats[D3, D3]
    translation: Floats[D3]
    """in the file's unit."""
    fisheye: bool | None = False
    """whether the distortions are cv2.fisheye's k1 k2 k3 k4, of the angle from the axis; None: four that may be these or k1 k2 p1 p2,
    the file does not say which."""

    @property
    def needs_view(self) -> bool:
        """Whether its images must be brought into a pinhole's before they are tracked: a fisheye's, or with skew."""
        return bool(self.fisheye) or abs(self.matrix[0, 1]) > _SKEW * self.matrix[0, 0]

    def without_lens(self) -> ImportedCamera:
        """Return a pinhole at its place that looks where it does."""
        matrix = self.matrix.copy()
        matrix[0, 1] = 0.0
        return replace(self, matrix=matrix, distortions=np.zeros(5), fisheye=False)


@dataclass(frozen=True)
class ImportedRig:
    """The cameras of a calibration, before their unit, names and sizes are settled."""

    family: str
    """which form it was, in words."""
    cameras: tuple[ImportedCamera, ...]
    unit_m: float | None = None
    """metres in one unit, where the form fixes it."""
    any_unit: bool = False
    """whether the form's unit means nothing: then lengths tell nothing either."""
    unposed: tuple[str, ...] = ()
    """cameras of the file that are left out, for it does not say where they stand."""

    def rig(self, unit_m: float) -> CameraRig:
        """Return the cameras in metres. All must have names and sizes. Raises HandtrackError.

        Last digits, in which the same rig differs from form to form, are cut.
        """
        return CameraRig(tuple(_camera(given, unit_m) for given in self.cameras))


def _camera(given: ImportedCamera, unit_m: float) -> Camera:
    assert given.name is not None
    assert given.size is not None
    if given.needs_view:
        raise HandtrackError(
            f"camera '{given.name}' has {'a fisheye lens' if given.fisheye else 'a matrix with skew'}, which no pinhole has. "
            "`handtrack new` makes a session of it, in which its images are seen through a pinhole."
        )
    turned = np.round(rotation_vector(nearest_rotation(given.rotation, given.name)), _DIGITS)
    return Camera(
        name=given.name,
        size=given.size,
        matrix=np.round(given.matrix, _DIGITS - 3),
        distortions=np.round(five_or_more(given.distortions), _DIGITS) + 0.0,
        rotation=rotation_matrix(turned + 0.0),
        translation=np.round(given.translation * unit_m, _DIGITS) + 0.0,
    )


def five_or_more(distortions: Floats[K]) -> Floats[K]:
    """Return coefficients filled up with zeros to the next number that OpenCV has, at least 5, and no longer than it must be."""
    filled = np.trim_zeros(np.asarray(distortions, float), "b")
    count = next((n for n in (5, 8, 12, 14) if n >= len(filled)), len(filled))
    return np.concatenate([filled, np.zeros(count - len(filled))])


def nearest_rotation(matrix: Floats[D3, D3], where: str) -> Floats[D3, D3]:
    """Return the rotation nearest to a matrix of few digits. Raises HandtrackError for one that is none."""
    u, singular, vt = np.linalg.svd(matrix)
    if np.abs(singular - 1).max() > _ROUGH or np.linalg.det(matrix) < 0:
        raise HandtrackError(
            f"{where}: its rotation is no rotation matrix: {np.round(matrix, 4).tolist()} (determinant "
            f"{np.linalg.det(matrix):.3g}, expected 1). Is it scaled, mirrored or cut off?"
        )
    return u @ vt


def with_names(rig: ImportedRig, names: Iterable[str]) -> ImportedRig:
    """Return the rig with its cameras named, in their order."""
    pairs = zip(rig.cameras, names, strict=True)
    return replace(rig, cameras=tuple(replace(camera, name=name) for camera, name in pairs))


def is_fisheye(model: Any, where: str) -> bool:
    """Return whether a lens model's name means `cv2.fisheye`'s polynomial, and not the standard one.

    Raises HandtrackError for a model that is neither.
    """
    plain = plain_word(model)
    if plain not in _IS_FISHEYE:
        raise HandtrackError(
            f"{where}: the lens model '{str(model)[:40]}' cannot be written without loss as k1 k2 p1 p2 k3 (k4 k5 k6), nor as "
            "cv2.fisheye's k1 k2 k3 k4, so it is refused. Calibrate with one of these models, or undistort the images and give "
            "their new matrix without distortion."
        )
    return _IS_FISHEYE[plain]


def plain_word(word: Any) -> str:
    """Return a word in small letters and digits alone: names that people write differ in the rest."""
    return "".join(sign for sign in str(word).lower() if sign.isalnum())


def numbers(value: Any, where: str, *shapes: tuple[int, ...], expected: str = "") -> Array[*Axes]:
    """Return a value as finite floats: lists, arrays, or OpenCV's matrices (rows, cols, data).

    Parameters
    ----------
    shapes
        Of which it gets the first that has as many numbers; none: as it is.
    expected
        These shapes in words.

    Raises
    ------
    HandtrackError
    """
    value = value["data"] if isinstance(value, Mapping) and "data" in value else value
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise HandtrackError(f"{where}: {str(value)[:60]}; expected numbers.") from None
    if array.size > _MOST_NUMBERS:
        raise HandtrackError(f"{where}: {array.size} numbers; expected those of one camera.")
    if not np.isfinite(array).all():
        raise HandtrackError(f"{where}: {array.tolist()}; expected finite numbers.")
    shape = next((shape for shape in shapes if math.prod(shape) == array.size), None)
    if shapes and shape is None:
        expected = expected or " or ".join(" x ".join(map(str, shape)) for shape in shapes)
        raise HandtrackError(f"{where}: {array.size} numbers; expected {expected}.")
    return array if shape is None else array.reshape(shape)


def numbers_at(
    table: Mapping[str, Any], key: str, where: str, *shapes: tuple[int, ...]
) -> Array[*Axes]:
    """Return the `numbers` of a table's key; none where it is missing."""
    return numbers(table.get(key, []), f"{where}, {key}", *shapes)


def whole_size(value: Any, where: str) -> tuple[int, int]:
    """Return width and height [px]. Raises HandtrackError."""
    size = numbers(value, where).ravel()
    if len(size) != 2 or (size != np.round(size)).any() or (size < 1).any():
        raise HandtrackError(
            f"{where}: {size.tolist()}; expected width and height in whole pixels."
        )
    return int(size[0]), int(size[1])


def rotation_of(value: Any, where: str) -> Floats[D3, D3]:
    """Return a rotation given as matrix or rotation vector [rad]. Raises HandtrackError."""
    what = "a rotation matrix of 3 x 3 or a rotation vector of 3 (Rodrigues), world to camera"
    array = numbers(value, where, (3, 3), (3,), expected=what)
    if array.size == 3 and np.linalg.norm(array) > 2 * np.pi:
        raise HandtrackError(
            f"{where}: {array.tolist()}, more than a whole turn; expected {what} in radians. Is it in degrees?"
        )
    return rotation_matrix(array) if array.size == 3 else array


# ---- Tables of K, distortion, R and t under the names that people give them: a file a camera, one table a camera, stacked arrays, or
# keys with the camera's name in them; and OpenCV's stereo pairs (K1, D1, K2, D2, R, T)


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
    "size": "size shape imageshape imagesize imsize resolution imageresolution imgsize sizepx imageshapewh "
    "cameraresolution",
    "width": "width imagewidth w",
    "height": "height imageheight h",
    "model": "model cameramodel distortionmodel lensmodel projectionmodel",
    "fisheye": "fisheye isfisheye fisheyemodel",
    "name": "name cameraname camname",
    "names": "names cameranames cameras",
    "unit": "unit units worldunits worldunit lengthunit translationunit",
    "inverse": "c2w cameratoworld camtoworld tworldcamera tworldcam twc",
    **{name: name for name in (*_FOCAL_AND_CENTRE, "xi")},
}
MEANS = {name: field for field, names in _NAMES.items() for name in names.split()}
"""our name of each key that people write, in small letters and digits alone"""
Known = Mapping[str, Any]
"""what a camera's table says, by our names"""
_Named = tuple[str | None, Known]
"""the same with the camera's name as far as there is one"""
_Tree = Mapping[str, Any] | list[Any]
_Path = tuple[str | int, ...]
_PAIRS = ({"1", "2"}, {"left", "right"}, {"l", "r"})
"""how OpenCV's users call the lenses of a stereo pair, which are no names of cameras"""
_AROUND = ("cameras", "calibration", "cams", "rig")  # keys of tables around cameras
_LIMIT = 64  # cameras
_STACKED = ("matrix", "distortions", "rotation", "translation", "pose", "inverse")
_DEEPEST = 8  # tables in tables
_LEAST_FOCAL_PX = 10.0  # less is in millimetres, or a share of the image's width


def read_tables(trees: Sequence[_Tree], where: str, alone: str) -> ImportedRig | None:
    """Return the cameras of nested tables, each of which may stand in several; None where there are none.

    Parameters
    ----------
    alone
        The name of a camera that has all of them.

    Raises
    ------
    HandtrackError
        Naming the camera and the key.
    """
    tables, beside, by_key = _tables(trees, alone)
    family = "one table per camera"
    if not 0 < len(tables) <= _LIMIT:
        return None
    if len(tables) == 2 and {"rotation", "translation"} <= beside.keys():
        # stereoRectify's R1, P1, R2, P2 are no poses
        own = ({k: v for k, v in known.items() if k != "projection"} for _, known in tables)
        if not any(_pose(known, where) for known in own):
            tables, family = _stereo(tables, beside, by_key), "stereo pair as OpenCV calibrates it"
    posed = len(tables) > 1
    wheres = [f"{where}, camera {name or i}" for i, (name, _) in enumerate(tables, 1)]
    placed = [not posed or _pose(known, w) is not None for (_, known), w in zip(tables, wheres)]
    if not any(placed):
        placed = [True] * len(tables)  # which camera_of refuses, and says what it expects
    cameras = tuple(
        camera_of(known, name, wheres[i], posed)
        for i, (name, known) in enumerate(tables)
        if placed[i]
    )
    unposed = tuple(name or f"{i + 1}" for i, (name, _) in enumerate(tables) if not placed[i])
    said = beside.get("unit")
    unit_m = None if said is None else metres_in(said, f"{where}: unit")
    return ImportedRig(family, cameras, unit_m, unposed=unposed)


def _tables(trees: Sequence[_Tree], alone: str) -> tuple[list[_Named], Known, bool]:
    """Return what is known of each camera, what beside, and whether names are of keys: a camera's values stand below one path, or else
    have one name in their keys, such as K_cam0, cam0_K, K0 or cam0/K. Of two that mean the same the first counts.
    """
    tables, by_key = dict[_Path, dict[str, Any]](), dict[_Path, dict[str, Any]]()
    for path, key, value in chain.from_iterable(map(_values, trees)):
        for field, name in ((key, ""), *_splits(key)):
            if meaning := MEANS.get(plain_word(field)):
                own = by_key.setdefault((*path, name), {}) if name else tables.setdefault(path, {})
                own.setdefault(meaning, value)
    for groups in (tables, by_key):
        cameras = {
            path: known
            for path, known in groups.items()
            if len(known) > 1 and ("matrix" in known or {"fx", "fy"} <= known.keys())
        }
        if cameras:
            break
    else:
        return [], {}, False
    beside = tables.get((), {}) | tables.get(next(iter(cameras))[:-1], {})
    found: list[_Named] = []
    for path, known in cameras.items():
        if not any(path[:n] in cameras for n in range(len(path))):
            names = known.get("name"), (alone, *path)[-1]
            found.append((next((n for n in names if isinstance(n, str) and n), None), known))
    return (_unstacked(beside) if () in cameras else []) or found, beside, groups is by_key


def _values(tree: _Tree, path: _Path = ()) -> Iterator[tuple[_Path, str, Any]]:
    """Yield what stands in nested tables and lists of them, each with the path of its camera, from which tables of lenses, of poses and
    around all cameras are left out, and its key.
    """
    named = isinstance(tree, Mapping)
    for key, value in ((str(k), v) for k, v in tree.items()) if named else enumerate(tree):
        if isinstance(value, Mapping):
            is_table = "data" not in value
        else:
            is_table = isinstance(value, list) and any(isinstance(v, Mapping) for v in value)
        if is_table and len(path) < _DEEPEST:
            plain = plain_word(key)
            is_part = plain in _AROUND or MEANS.get(plain) in ("matrix", "pose")
            yield from _values(value, path if is_part else (*path, key))
        elif (
            not is_table and value is not None and not (isinstance(value, str) and value == "null")
        ):
            yield path, str(key), value


def _unstacked(known: Known) -> list[_Named]:
    """Return tables from arrays that have one row a camera; none where the file is of one camera."""
    shape = np.asarray(known.get("matrix"), dtype=object).shape
    if len(shape) != 3 or shape[0] > _LIMIT:
        return []
    count, shapes = shape[0], {f: np.asarray(v, dtype=object).shape for f, v in known.items()}
    stacked = {
        field
        for field, shape in shapes.items()
        if shape[:1] == (count,) and (field in _STACKED or len(shape) == 2)
    }
    names = map(str, known["names"]) if shapes.get("names") == (count,) else [None] * count
    fields = [field for field in known if field not in ("name", "names", "unit")]
    return [
        (name, {field: known[field][i] if field in stacked else known[field] for field in fields})
        for i, name in enumerate(names)
    ]


def _splits(key: str) -> Iterator[tuple[str, str]]:
    """Yield how a key may be a value's and a camera's name."""
    for sign in re.finditer(r"[_./\- ]", key[:80]):
        first, last = key[: sign.start()], key[sign.end() :]
        yield first, last
        yield last, first
    joined = re.fullmatch(r"(.*[A-Za-z])(\d+|left|right|l|r)", key[:80], re.IGNORECASE)
    if joined:
        yield joined[1], joined[2]


def _stereo(tables: list[_Named], beside: Known, by_key: bool) -> list[_Named]:
    """Return two cameras of which the second's pose from the first stands beside them. by_key: their names are of keys."""
    if by_key and {str(name).lower() for name, _ in tables} in _PAIRS:
        tables = [(None, known) for _, known in sorted(tables, key=lambda table: str(table[0]))]
    shared = {
        k: beside[k] for k in ("size", "width", "height", "model", "fisheye", "xi") if k in beside
    }
    poses = (np.eye(3), np.zeros(3)), (beside["rotation"], beside["translation"])
    return [
        (name, {**shared, **known, "rotation": turn, "translation": moved})
        for (name, known), (turn, moved) in zip(tables, poses, strict=True)
    ]


def camera_of(known: Known, name: str | None, where: str, posed: bool) -> ImportedCamera:
    """Return the camera of a table. posed: whether it must say where it stands. Raises HandtrackError."""
    said = [
        str(known[field]) for field in ("model", "fisheye") if known.get(field) not in (None, "")
    ]
    models = [is_fisheye(word, where) for word in said]
    if "distortions" not in known:
        raise HandtrackError(
            f"{where}: no distortion coefficients, only {', '.join(known)}; expected `dist` (k1 k2 p1 p2 k3), or zeros "
            "where the images have none."
        )
    distortions = numbers(known["distortions"], f"{where}, distortion").ravel()
    if known.get("xi"):
        raise HandtrackError(
            f"{where}: `xi` is of an omnidirectional lens (Mei's), which is not read; undistort its images to a pinhole's."
        )
    pose = _pose(known, where)
    if posed and pose is None:
        raise HandtrackError(
            f"{where}: no pose, only {', '.join(known)}; expected `R` (matrix or rotation vector) and `t`, world to "
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
        _size(known, where),
        matrix,
        distortions,
        *(pose or (np.eye(3), np.zeros(3))),
        None if lens_open else any(models),
    )


def _matrix(known: Known, where: str) -> Floats[D3, D3]:
    apart = [known.get(name) for name in _FOCAL_AND_CENTRE]
    value = numbers(known.get("matrix", apart), f"{where}, matrix or fx fy cx cy")
    if value.shape == (4,):
        return camera_matrix(*value.tolist())
    return numbers(value, f"{where}, matrix", (3, 3))


def _size(known: Known, where: str) -> tuple[int, int] | None:
    if "size" in known:
        return whole_size(numbers(known["size"], f"{where}, size").ravel()[:2], f"{where}, size")
    if {"width", "height"} <= known.keys():
        return whole_size([known["width"], known["height"]], f"{where}, width and height")
    return None


def _pose(known: Known, where: str) -> tuple[Floats[D3, D3], Floats[D3]] | None:
    """Return where a table says its camera stands; null, as for one that was not found, says nothing."""
    whole = known.get("pose", known.get("inverse"))
    if {"rotation", "translation"} <= known.keys():
        many = known["translation"]
        if np.size(np.asarray(many, dtype=object)) > 3:  # calibrateCamera's: the board's, by view
            return None
        moved = numbers(known["translation"], f"{where}, translation", (3,))
        return rotation_of(known["rotation"], f"{where}, rotation"), moved
    if whole is not None:
        pose = numbers(whole, f"{where}, pose", (3, 4), (4, 4))
        if (pose[3:] != [0, 0, 0, 1]).any():
            raise HandtrackError(
                f"{where}, pose: its last row is {pose[3].tolist()}; expected 0 0 0 1. Is it transposed?"
            )
        turned, moved = pose[:3, :3], pose[:3, 3]
        return (turned, moved) if "pose" in known else (turned.T, -turned.T @ moved)
    return _rectified(known, where)


def _rectified(known: Known, where: str) -> tuple[Floats[D3, D3], Floats[D3]] | None:
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
