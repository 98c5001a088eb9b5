"""Cameras as somebody's file gives them: in its own unit of length, perhaps without names or image sizes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from handtrack.arrays import D3, Array, Axes, Floats, K, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera, CameraRig
from handtrack.geometry.rotation import rotation_matrix, rotation_vector

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
            "pinholeradtan,rationalpolynomial,rational,regular,linear,fullopencv,simplepinhole,false,no",
        ),
        (
            True,
            "fisheye,opencvfisheye,equidistant,equi,pinholeequi,kannalabrandt,kannalabrandt4,kb,kb4,true,yes",
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
    return rotation_matrix(array) if array.size == 3 else array
