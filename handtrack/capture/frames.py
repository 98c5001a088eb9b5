"""What a camera gave for each frame: numbered image files here, videos in `video.py`.

A miss is a value, None.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from handtrack.arrays import Array
from handtrack.errors import HandtrackError

COLOUR, MASK, DEPTH, RAW = "image", "mask", "depth", "raw"
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm", ".jp2")
_READ_FLAGS = {
    COLOUR: cv2.IMREAD_COLOR,
    MASK: cv2.IMREAD_GRAYSCALE,
    DEPTH: cv2.IMREAD_UNCHANGED,  # keeps 16 bits
    RAW: cv2.IMREAD_UNCHANGED,  # a Bayer mosaic, 8 or 16 bits
}


class FrameSource(Protocol):
    """Images of one camera by frame number. Safe to read from several threads."""

    @property
    def where(self) -> str:
        """Path or pattern, for messages."""
        ...

    @property
    def size(self) -> tuple[int, int] | None:
        """width, height [px] of the first readable frame; None when nothing is readable."""
        ...

    @property
    def frames(self) -> range:
        """From 0 to the last frame there is; frames in between may be missing."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was odd so far, in plain sentences."""
        ...

    def has(self, frame: int) -> bool:
        """Whether there should be an image for a frame; reading it may still fail."""
        ...

    def read(self, frame: int) -> Array | None:
        """Return the image of a frame, None where there is none."""
        ...


def frame_number(name: str) -> int:
    """Return the frame of a file name: the last group of digits before its suffix.

    Raises HandtrackError.
    """
    groups = re.findall(r"\d+", Path(name).stem)
    if not groups:
        raise HandtrackError(
            f"{name}: no digits in the file name; expected the frame number in it, such as "
            "000018.png."
        )
    return int(groups[-1])


def files_by_frame(paths: Iterable[Path]) -> dict[int, Path]:
    """Return files by their frame number, ascending.

    Raises HandtrackError when two have the same number.
    """
    by_frame: dict[int, Path] = {}
    for path in sorted(paths):
        frame = frame_number(path.name)
        if frame in by_frame:
            raise HandtrackError(
                f"{path.parent}: '{by_frame[frame].name}' and '{path.name}' are both frame "
                f"{frame}; expected one file a frame. The frame is the last group of digits in "
                "the name."
            )
        by_frame[frame] = path
    return dict(sorted(by_frame.items()))


class ImageFiles:
    """Numbered image files of one kind: colour (H, W, 3) uint8 BGR, mask (H, W) uint8 or depth (H,
    W) uint16.

    expected_size: (width, height) [px] of the calibration; another size raises HandtrackError when
    read.
    """

    def __init__(
        self,
        paths: Iterable[Path],
        kind: str = COLOUR,
        expected_size: tuple[int, int] | None = None,
        where: str = "",
    ) -> None:
        self._files = files_by_frame(paths)
        self._kind = kind
        self._expected_size = expected_size
        self._where = where
        self._warnings: dict[int, str] = {}
        self._lock = threading.Lock()

    @property
    def where(self) -> str:
        return self._where or (str(next(iter(self._files.values())).parent) if self._files else "")

    @property
    def size(self) -> tuple[int, int] | None:
        for frame in self._files:
            image = self.read(frame)
            if image is not None:
                return image.shape[1], image.shape[0]
        return None

    @property
    def frames(self) -> range:
        return range(max(self._files, default=-1) + 1)

    @property
    def warnings(self) -> tuple[str, ...]:
        with self._lock:
            return tuple(self._warnings[frame] for frame in sorted(self._warnings))

    def has(self, frame: int) -> bool:
        return frame in self._files

    def path(self, frame: int) -> Path:
        """Return the file of a frame that there is."""
        return self._files[frame]

    def read(self, frame: int) -> Array | None:
        path = self._files.get(frame)
        if path is None:
            return None
        image, problem = _decode(path, _READ_FLAGS[self._kind])
        if image is None:
            with self._lock:
                self._warnings[frame] = f"{path}: {problem}; frame {frame} counts as missing."
            return None
        if self._kind == DEPTH and (image.dtype != np.uint16 or image.ndim != 2):
            raise HandtrackError(
                f"{path}: depth must be one channel of 16 bits; found {image.dtype}, shape "
                f"{image.shape}. Eight bits, or colours, are a picture of depth, too coarse to measure by: export "
                "16 bit PNG or TIFF files, and say in depth_scale_m how many metres one unit is."
            )
        check_size(image, self._expected_size, f"{path}, frame {frame}")
        return image


def check_size(image: Array, expected: tuple[int, int] | None, where: str) -> None:
    """Raise HandtrackError unless an image has the calibration's size (width, height)."""
    found = (image.shape[1], image.shape[0])
    if expected is not None and found != tuple(expected):
        raise HandtrackError(
            f"{where}: the image is {found[0]} x {found[1]}, but the camera is calibrated for "
            f"{expected[0]} x {expected[1]}. Use the images the calibration belongs to, or scale "
            "its matrix and size."
        )


def _decode(path: Path, flags: int) -> tuple[Array | None, str]:
    try:
        # not cv2.imread, which fails on non-ASCII paths on Windows
        data = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        return None, f"cannot be read ({error.strerror})"
    if data.size == 0:
        return None, "the file is empty"
    if path.suffix.lower() == ".png" and b"IEND" not in data[-64:].tobytes():
        return None, "the PNG is cut off"  # some decoders fill the rest with black
    if path.suffix.lower() in (".jpg", ".jpeg") and _is_cut_jpeg(data.tobytes()):
        return None, "the JPEG is cut off"
    try:
        image = cv2.imdecode(data, flags)
    except cv2.error as error:
        return None, f"not a readable image ({error.err})"
    return (None, "not a readable image") if image is None else (image, "")


def _is_cut_jpeg(data: bytes) -> bool:
    """Return whether the end marker is missing; one in the first half is an embedded thumbnail's."""
    return data.rfind(b"\xff\xd9") < len(data) // 2
