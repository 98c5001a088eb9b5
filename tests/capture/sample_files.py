"""Files in the forms that other programs write: by their own libraries where there are any, else by their documentation.

`samples/calibration` has the rig of `rig_of_two`, but for what a form has no place for; `samples/hands` the points of `hand`, or,
where no point can be missing, 50 in their place; `samples/bodies` the person of tests/capture/joints/people.py.
"""

import shutil
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack import Camera, CameraRig
from handtrack.arrays import D3, D21, Array, F, Floats
from handtrack.geometry.rotation import rotation_matrix

SAMPLES = Path(__file__).parent / "samples"
LIBRARIES = {
    "calibration/matlab_object": ("matio",), "hands/deeplabcut_h5": ("h5py", "pandas", "tables"), "hands/sleap_h5": ("h5py",),
    "bodies/sleap_h5": ("h5py",), "truth/c3d": ("c3d",),
}  # fmt: skip
"""without which a form is not read"""
HAND_FRAMES = 3


def forms(kind: str) -> list[str]:
    return sorted(f"{kind}/{path.name}" for path in (SAMPLES / kind).iterdir())


def sample(form: str, folder: Path) -> list[Path]:
    """Copy the files of a form into a folder; return those that a user names."""
    for library in LIBRARIES.get(form, ()):
        pytest.importorskip(library)
    shutil.copytree(SAMPLES / form, folder, dirs_exist_ok=True)
    return [folder / path.name for path in sorted((SAMPLES / form).iterdir())]


def filmed(
    path: Path,
    pictures: Iterable[Array],
    code: str = "MJPG",
    fps: float = 30.0,
    size: tuple[int, int] = (64, 48),
) -> Path:
    """Write a video of pictures (H, W, 3)."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), fps, size)
    for picture in pictures:
        writer.write(picture)
    writer.release()
    return path


def rig_of_two() -> CameraRig:
    """Return two cameras half a metre from a hand, the first at the origin, as a stereo calibration has them."""
    first = Camera(
        "cam0", (640, 480), np.array([[612.25, 0, 318.4375], [0, 611.5, 243.1875], [0, 0, 1]]),
        np.array([-0.21, 0.07, 0.0011, -0.0007, 0.013]), np.eye(3), np.zeros(3),
    )  # fmt: skip
    rotation = rotation_matrix(np.array([0.031, -0.52, 0.047]))
    second = Camera(
        "cam1", (640, 480), np.array([[598.75, 0, 325.5625], [0, 599.25, 236.3125], [0, 0, 1]]),
        np.array([-0.19, 0.05, -0.0004, 0.0009, 0.021]), rotation, np.array([0.271, -0.0123, 0.0817]),
    )  # fmt: skip
    return CameraRig((first, second))


def hand() -> Floats[F, D21, D3]:
    """Return column, row [px], confidence of three frames; one point of the second is missing."""
    rng = np.random.default_rng(5)
    shape = (HAND_FRAMES, 21, 2), (HAND_FRAMES, 21, 1)
    points = np.concatenate([rng.uniform(100, 400, shape[0]), rng.uniform(0.65, 0.95, shape[1])], 2)
    points = np.round(points, 3)
    points[1, 7] = (np.nan, np.nan, 0.0)
    return points
