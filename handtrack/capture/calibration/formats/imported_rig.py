"""Cameras as somebody's file gives them: in its own unit of length, perhaps without names or image sizes; and read from tables."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
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
    "unit": "unit units worldunits worldunit lengthunit translationunit",
    "inverse": "c2w cameratoworld camtoworld tworldcamera tworldcam twc",
    **{name: name for name in (*_FOCAL_AND_CENTRE, "xi")},
}
MEANS = {name: field for field, names in _NAMES.items() for name in names.split()}
"""our name of each key that people write, in small letters and digits alone"""
_STEREO = re.compile(r"^(.*?)_?(1|2|left|right|l|r)$", re.IGNORECASE)
_LIMIT = 64  # cameras
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
    models = [is_fisheye(word, where) for word in said]
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
        _size(known, where),
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


def _size(known: Mapping[str, Any], where: str) -> tuple[int, int] | None:
    if "size" in known:
        return whole_size(numbers(known["size"], f"{where}, size").ravel()[:2], f"{where}, size")
    if {"width", "height"} <= known.keys():
        return whole_size([known["width"], known["height"]], f"{where}, width and height")
    return None


def _pose(known: Mapping[str, Any], where: str) -> tuple[Floats[D3, D3], Floats[D3]] | None:
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
