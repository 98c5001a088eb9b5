"""The detector's weights: where they are, and whether they are what they should be. They are no part of the program."""

from __future__ import annotations

import hashlib
import os
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import distributions
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.files.atomic import replacing
from handtrack.files.user_folder import user_data_folder

VARIABLE = "HANDTRACK_DETECTOR"
"""the environment variable that names a file of weights"""
LICENCE = "Apache License 2.0, Google: the hand landmarker of MediaPipe, packed 2023-04-26"
SHA256 = "fbc2a30080c3c557093b5ddfc334698132eb341044ccee322ccf8bcf3607cde1"
"""of the file that handtrack was tested with, as Google packs it"""
_NAME = "hand_landmarker.task"
_PALM, _LANDMARKS = "hand_detector.tflite", "hand_landmarks_detector.tflite"
_MOST_BYTES = 64 << 20  # of the file and of either network; the known ones take 8, 2.3 and 5.5 MB
_TFLITE = b"TFL3"  # from byte 4 on


@dataclass(frozen=True, repr=False)
class Weights:
    """The two networks as they are in the file."""

    path: Path
    palm: bytes
    landmarks: bytes
    is_known: bool
    """whether it is, byte for byte, the file that handtrack was tested with"""


def installed_weights() -> Path:
    """Return where `handtrack detector install` puts the weights; nothing need be there."""
    return user_data_folder() / "detector" / _NAME


def find_weights(given: Path | None = None) -> Path:
    """Return the file of weights: the given one, else what the environment names, else the installed one.

    Raises HandtrackError, one sentence, where there is none.
    """
    named = os.environ.get(VARIABLE)
    for path, source in ((given, "--weights"), (Path(named) if named else None, VARIABLE)):
        if path is not None:
            if not path.is_file():
                raise HandtrackError(
                    f"{source} {path}: no such file; expected the detector's weights, {_NAME}."
                )
            return path
    if installed_weights().is_file():
        return installed_weights()
    raise HandtrackError(
        f"the hand detector has no weights: `handtrack detector install FILE` keeps a copy of Google's {_NAME}, or name the "
        f"file with --weights or in {VARIABLE}; all else works without it."
    )


def read_weights(path: Path) -> Weights:
    """Return the networks of a .task file, its headers and sizes checked before anything is unpacked. Raises HandtrackError."""
    _check_header(path)
    try:
        with zipfile.ZipFile(path) as archive:
            palm, landmarks = (_network(archive, name, path) for name in (_PALM, _LANDMARKS))
    except (HandtrackError, MemoryError):
        raise
    except Exception as error:  # zipfile and zlib fail in many ways on damaged bytes
        raise _no_weights(path, f"it cannot be unpacked ({error})") from None
    return Weights(path, palm, landmarks, digest_of(path) == SHA256)


def digest_of(path: Path) -> str:
    """Return a file's SHA-256, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def install_weights(source: Path) -> Path:
    """Copy the known file to the user's data folder; return the copy. Raises HandtrackError for any other file."""
    _check_header(source)
    found = digest_of(source)
    if found != SHA256:
        raise HandtrackError(
            f"{source}: its SHA-256 is {found}; expected {SHA256}, the {_NAME} that handtrack was tested with. Nothing was "
            f"installed. If you trust this file, name it with --weights or in {VARIABLE}."
        )
    target = installed_weights()
    target.parent.mkdir(parents=True, exist_ok=True)
    with replacing(target) as part:
        part.write_bytes(source.read_bytes())
    return target


def weights_in_packages() -> Path:
    """Return the known file inside an installed Python package: some carry it whole. Raises HandtrackError where none does."""
    for path in _packed_files():
        if path.is_file() and digest_of(path) == SHA256:
            return path
    raise HandtrackError(
        f"no installed Python package carries the {_NAME} that handtrack was tested with. Give the file: `handtrack detector "
        f"install FILE`; Google offers it as the model of MediaPipe's hand landmarker. SHA-256 {SHA256}."
    )


def _packed_files() -> Iterator[Path]:
    for package in distributions():
        for file in package.files or ():
            if file.name.endswith(".task"):
                yield Path(str(file.locate()))


def _check_header(path: Path) -> None:
    try:
        size = path.stat().st_size
        if not path.is_file():
            raise _no_weights(path, "it is no file")
        if size > _MOST_BYTES:
            raise _no_weights(path, f"it has {size / 1e6:.0f} MB")
        is_zip = zipfile.is_zipfile(path)  # by its end: Google's begins with two bytes of padding
    except OSError as error:
        raise HandtrackError(f"{path}: the weights cannot be read: {error.strerror}.") from None
    if not is_zip:
        raise _no_weights(path, "it is no zip")


def _network(archive: zipfile.ZipFile, name: str, path: Path) -> bytes:
    if name not in archive.namelist():
        raise _no_weights(path, f"there is no {name} in it")
    if archive.getinfo(name).file_size > _MOST_BYTES:
        raise _no_weights(path, f"{name} would take {archive.getinfo(name).file_size / 1e6:.0f} MB")
    data = archive.read(name)
    if data[4:8] != _TFLITE:
        raise _no_weights(path, f"{name} is no network in TFLite's form")
    return data


def _no_weights(path: Path, why: str) -> HandtrackError:
    return HandtrackError(
        f"{path}: these are not the detector's weights: {why}; expected {_NAME}, a zip of {_PALM} and {_LANDMARKS}, 8 MB. Was "
        "it cut off while it was copied?"
    )
