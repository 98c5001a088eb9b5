"""COLMAP's models: cameras and images as text or binary; the first pixel's centre is (0.5, 0.5), and lengths have no unit."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from typing import BinaryIO, NamedTuple, TypeVar

import numpy as np

from handtrack.capture.calibration.formats.given_rig import (
    GivenCamera,
    GivenRig,
    is_fisheye,
    matrix_of,
)
from handtrack.errors import HandtrackError
from handtrack.files.given_files import check_given
from handtrack.geometry.rotation import matrix_from_quaternion

_T = TypeVar("_T")
_HALF = 0.5
_MOST = 64  # images: a rig has one a camera
_LARGEST = 4 << 30  # bytes of images.*, of which the points are passed over
_MODELS = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
    "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE",
)  # fmt: skip
_COUNTS = (3, 4, 4, 5, 8, 8, 12, 5, 4, 5, 12)
_PLACES = {
    "SIMPLE_PINHOLE": "f cx cy", "PINHOLE": "fx fy cx cy", "SIMPLE_RADIAL": "f cx cy k1", "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2", "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4", "SIMPLE_RADIAL_FISHEYE": "f cx cy k1", "RADIAL_FISHEYE": "f cx cy k1 k2",
}  # fmt: skip
_BENT = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]
_FISHEYE = ["k1", "k2", "k3", "k4"]


class _Lens(NamedTuple):
    model: str
    size: tuple[int, int]
    parameters: tuple[float, ...]


class _Image(NamedTuple):
    name: str
    camera: int
    pose: tuple[float, ...]
    """qw qx qy qz tx ty tz, world to camera"""


def colmap_folder(path: Path) -> Path | None:
    """Return the folder of a COLMAP model, given it, one above it, or one of its files; None for anything else."""
    if path.is_file():
        stem, suffix = path.stem, path.suffix
        return path.parent if stem in ("cameras", "images") and suffix in (".txt", ".bin") else None
    below = [path, path / "sparse" / "0", path / "sparse", path / "0"]
    return next(
        (f for f in below if any((f / f"cameras{s}").is_file() for s in (".bin", ".txt"))), None
    )


def read_colmap(folder: Path) -> GivenRig:
    """Return a camera for each image of a model. Raises HandtrackError."""
    suffix = ".bin" if (folder / "cameras.bin").is_file() else ".txt"
    cameras, images = folder / f"cameras{suffix}", folder / f"images{suffix}"
    for path in (cameras, images):
        check_given(path, f"COLMAP's {path.name}", _LARGEST)
    lenses = _checked(_binary_lenses if suffix == ".bin" else _text_lenses, cameras)
    shots = _checked(_binary_images if suffix == ".bin" else _text_images, images)
    if not shots or not lenses:
        raise HandtrackError(
            f"{folder}: the model has no images with a pose; expected one image of each camera."
        )
    names = _camera_names([shot.name for shot in shots], images)
    rig = [_camera(lenses, shot, name, cameras) for shot, name in zip(shots, names, strict=True)]
    return GivenRig("COLMAP model", tuple(rig), any_unit=True)


def _checked(read: Callable[[Path], _T], path: Path) -> _T:
    try:
        return read(path)
    except (ValueError, IndexError, struct.error, OSError, OverflowError) as error:
        raise HandtrackError(
            f"{path}: not readable as COLMAP writes it ({error}). Export the model again."
        ) from None


def _text_rows(path: Path) -> Iterator[tuple[list[str], str]]:
    with path.open(encoding="utf-8") as file:
        while line := file.readline(1 << 16):
            if not line.endswith("\n"):
                while len(rest := file.readline(1 << 20)) and not rest.endswith("\n"):
                    pass  # points of a large image
            if not line.startswith("#"):
                yield line.split(), line


def _text_lenses(path: Path) -> dict[int, _Lens]:
    return {
        int(words[0]): _Lens(words[1], (int(words[2]), int(words[3])), tuple(map(float, words[4:])))
        for words, _ in _text_rows(path)
        if words
    }


def _text_images(path: Path) -> list[_Image]:
    rows, images = _text_rows(path), []
    for words, line in rows:
        if not words:
            continue
        name = line.rstrip("\n").split(" ", 9)[9] if len(words) >= 10 else words[9]
        images.append(_Image(name, int(words[8]), tuple(map(float, words[1:8]))))
        _check_count(len(images), path)
        next(rows, None)  # its points
    return images


def _binary_lenses(path: Path) -> dict[int, _Lens]:
    with path.open("rb") as file:
        (count,) = _take(file, "<Q")
        _check_count(count, path)
        lenses = {}
        for _ in range(count):
            number, model, width, height = _take(file, "<IiQQ")
            if not 0 <= model < len(_MODELS):
                raise ValueError(f"an unknown camera model {model}")
            lenses[number] = _Lens(
                _MODELS[model], (width, height), _take(file, f"<{_COUNTS[model]}d")
            )
        return lenses


def _binary_images(path: Path) -> list[_Image]:
    with path.open("rb") as file:
        (count,) = _take(file, "<Q")
        _check_count(count, path)
        images = []
        for _ in range(count):
            _, *pose, camera = _take(file, "<I7dI")
            name = bytearray()
            while (sign := file.read(1)) != b"\0":
                if not sign or len(name) > 1000:
                    raise ValueError("a name without end")
                name += sign
            (points,) = _take(file, "<Q")
            file.seek(24 * points, 1)
            images.append(_Image(name.decode(), camera, tuple(pose)))
        return images


def _take(file: BinaryIO, form: str) -> tuple:
    return struct.unpack(form, file.read(struct.calcsize(form)))


def _check_count(count: int, path: Path) -> None:
    if count > _MOST:
        raise HandtrackError(
            f"{path}: more than {_MOST} images; expected one of each camera of a rig that stands still. Keep one image a camera "
            "in the model (`colmap image_deleter`)."
        )


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


def _camera(lenses: dict[int, _Lens], image: _Image, name: str, path: Path) -> GivenCamera:
    where = f"{path}, camera {image.camera}"
    if image.camera not in lenses:
        raise HandtrackError(
            f"{path}: no camera {image.camera}, which the image '{image.name}' names."
        )
    lens = lenses[image.camera]
    if lens.model not in _PLACES:
        is_fisheye(f"{lens.model} (COLMAP)", where)  # raises: of no model that is read
    places = _PLACES[lens.model].split()
    if len(lens.parameters) != len(places):
        raise HandtrackError(
            f"{where}: {len(lens.parameters)} parameters; {lens.model} has {', '.join(places)}."
        )
    values = dict(zip(places, lens.parameters, strict=True))
    if not np.isfinite([*lens.parameters, *image.pose]).all() or not any(image.pose[:4]):
        raise HandtrackError(f"{where}: parameters or pose are not finite numbers.")
    focal = values.get("f", 0.0)
    matrix = matrix_of(
        values.get("fx", focal), values.get("fy", focal), values["cx"] - _HALF, values["cy"] - _HALF
    )
    fisheye = lens.model.endswith("FISHEYE")
    bent = np.array([values.get(key, 0.0) for key in (_FISHEYE if fisheye else _BENT)])
    rotation = matrix_from_quaternion(np.array(image.pose[:4]))
    moved = np.array(image.pose[4:])
    return GivenCamera(name, lens.size, matrix, bent, rotation, moved, fisheye)
