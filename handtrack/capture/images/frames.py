"""FrameSource, what a camera gave for each frame, and its numbered image files (videos: `video.py`).

A miss is a value, None.
"""

from __future__ import annotations

import errno
import io
import os
import re
import struct
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from handtrack.arrays import Array, Axes, Bytes, H, W, number_runs
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import scaled_by

_MOST_RUNS = 6


class FrameNotes:
    """Sentences by frame; those that differ by numbers alone are told once. Safe from several threads."""

    def __init__(self) -> None:
        self._texts: dict[int, tuple[str, ...]] = {}
        self._lock = threading.Lock()

    def add(self, frame: int, *texts: str) -> None:
        """Note what was odd about a frame, in place of what was noted of it before."""
        with self._lock:
            self._texts[frame] = texts

    @property
    def texts(self) -> tuple[str, ...]:
        """Each kind of oddity once: the first frame's sentence, and which frames are like it."""
        with self._lock:
            met = sorted(self._texts.items())
        kinds: dict[str, list[tuple[int, str]]] = {}
        for frame, texts in met:
            for text in texts:
                kinds.setdefault(re.sub(r"\d+", "", text), []).append((frame, text))
        return tuple(_sentence(similar) for similar in kinds.values())


def listed(frames: Sequence[int]) -> str:
    """Return frame numbers as runs, such as `3-5, 9`, at most a few of them. frames: ascending."""
    runs = number_runs(frames)
    shown = ", ".join(f"{a}-{b - 1}" if b - a > 1 else str(a) for a, b in runs[:_MOST_RUNS])
    return shown + (f" and {len(runs) - _MOST_RUNS} more runs" if len(runs) > _MOST_RUNS else "")


def _sentence(similar: Sequence[tuple[int, str]]) -> str:
    """Return the first text, and the frames of the others. alike: (frame, text), ascending."""
    (_, text), others = similar[0], [frame for frame, _ in similar[1:]]
    if not others:
        return text
    return f"{text} The same in {len(others)} more frames: {listed(others)}."


COLOUR, MASK, DEPTH, RAW = "image", "mask", "depth", "raw"
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm", ".jp2")
_LAST_FRAME = 10_000_000  # days of video; a larger number in a name is a date or a time
_SECONDS = r"\d{10}\.\d+$"  # since 1970, which is no frame either
_PNG, _JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
_AS_IT_IS = cv2.IMREAD_UNCHANGED  # all bits, all channels, unturned
_LEAST_HAND = 128  # of a mask's 255: half
_DIM_16 = 1 << 15  # a picture of 16 bits none of which reaches the last


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
    def known_frames(self) -> range:
        """The same as far as is known without reading images."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was odd so far, in plain sentences."""
        ...

    def has(self, frame: int) -> bool:
        """Whether there should be an image for a frame; reading it may still fail."""
        ...

    def read(self, frame: int) -> Array[H, W, *Axes] | None:
        """Return the image of a frame, None where there is none."""
        ...


def frame_number(name: str) -> int:
    """Return the frame of a file name: the last group of digits before its suffix.

    Raises HandtrackError.
    """
    stem = os.path.splitext(os.path.basename(name))[0]
    groups = re.findall(_SECONDS, stem) or re.findall(r"\d+", stem)
    if not groups:
        raise HandtrackError(
            f"{name}: no digits in the file name; expected the frame number in it, such as "
            "000018.png."
        )
    if float(groups[-1]) > _LAST_FRAME:
        raise HandtrackError(
            f"{name}: {groups[-1]} is no frame number, which are at most {_LAST_FRAME}. Is it a time? Rename the files "
            "to count frames from 0, and give their times as `timestamps` in session.toml."
        )
    return int(groups[-1])


def files_by_frame(paths: Iterable[Path]) -> dict[int, Path]:
    """Return files by their frame number, ascending.

    Raises HandtrackError when two have the same number.
    """
    by_frame: dict[int, Path] = {}
    for path in sorted(paths, key=str):  # which is quicker than paths
        frame = frame_number(str(path))
        if frame in by_frame:
            raise HandtrackError(
                f"{path.parent}: '{by_frame[frame].name}' and '{path.name}' are both frame "
                f"{frame}; expected one file a frame. The frame is the last group of digits in "
                "the name."
            )
        by_frame[frame] = path
    return dict(sorted(by_frame.items()))


def frames_of(files: dict[int, Path]) -> range:
    """Return the frames from 0 to the last of what is there by frame, ascending; asked often, so the last one is not sought."""
    return range(next(reversed(files), -1) + 1)


class DerivedFrames:
    """A source whose images are made of another's, or read in another way; see FrameSource."""

    def __init__(
        self,
        source: FrameSource,
        read: Callable[[int], Array[H, W, *Axes] | None],
        size: tuple[int, int] | None = None,
    ) -> None:
        """read: gives the image of a frame. size: width, height [px] of these images, where they have another than the source's."""
        self.source, self._read, self._size = source, read, size
        self.where = source.where

    @property
    def size(self) -> tuple[int, int] | None:
        found = self.source.size
        return found and (self._size or found)

    @property
    def frames(self) -> range:
        return self.source.frames

    @property
    def known_frames(self) -> range:
        return self.source.known_frames

    @property
    def warnings(self) -> tuple[str, ...]:
        return self.source.warnings

    def has(self, frame: int) -> bool:
        return self.source.has(frame)

    def read(self, frame: int) -> Array[H, W, *Axes] | None:
        return self._read(frame)


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
        in_order: bool = False,
    ) -> None:
        """in_order: frames are counted as the files come, whatever numbers their names have."""
        self._files = dict(enumerate(paths)) if in_order else files_by_frame(paths)
        self._kind = kind
        self._expected_size = expected_size
        self.where = where or next((str(path.parent) for path in self._files.values()), "")
        self._notes = FrameNotes()
        self._looked_closer = False

    @property
    def size(self) -> tuple[int, int] | None:
        for frame in self._files:
            image = self.read(frame)
            if image is not None:
                return image.shape[1], image.shape[0]
        return None

    @property
    def frames(self) -> range:
        return frames_of(self._files)

    @property
    def known_frames(self) -> range:
        return self.frames

    @property
    def warnings(self) -> tuple[str, ...]:
        return self._notes.texts

    def has(self, frame: int) -> bool:
        return frame in self._files

    def path(self, frame: int) -> Path:
        """Return the file of a frame that there is."""
        return self._files[frame]

    def read(self, frame: int) -> Array[H, W, *Axes] | None:
        path = self._files.get(frame)
        if path is None:
            return None
        data, problem = _bytes(path)
        where = f"{path}, frame {frame}"
        check_announced(announced_size(data, where), self._expected_size, where)
        flags = cv2.IMREAD_COLOR if self._kind == COLOUR else _AS_IT_IS
        image = None if problem else _decoded(data, flags)
        if image is None:
            problem = problem or "not a readable image"
            self._notes.add(frame, f"{path}: {problem}; frame {frame} counts as missing.")
            return None
        if self._kind == DEPTH:
            if image.dtype != np.uint16 or image.ndim != 2:
                raise HandtrackError(
                    f"{path}: depth must be one channel of 16 bits; found {image.dtype}, shape "
                    f"{image.shape}. Export 16 bit PNG or TIFF files, and say in depth_scale_m how many metres one unit is. "
                    "Eight bits, or colours, are a picture of depth, too coarse to measure by."
                )
        elif self._kind == MASK:
            image = _mask(image, path)
        elif self._kind == COLOUR and not self._looked_closer:
            self._looked_closer = True
            self._notes.add(frame, *_oddities(data, image, path))
        check_size((image.shape[1], image.shape[0]), self._expected_size, where)
        return image


def announced_size(data: bytes, where: str) -> tuple[int, int] | None:
    """Return width, height [px] as an image file announces them; None of files that say it in no
    way known here.

    Parameters
    ----------
    where
        The file, for errors.

    Raises
    ------
    HandtrackError
        For a picture so large that Pillow takes it for an attack.
    """
    from PIL import Image  # looks at the head of a file; OpenCV decodes it

    try:
        with Image.open(io.BytesIO(data)) as image:
            return image.size
    except Image.DecompressionBombError as error:
        raise HandtrackError(
            f"{where}: too large a picture to be read ({error}) Scale it down, and the calibration with it."
        ) from None
    except (OSError, ValueError, SyntaxError, struct.error):  # cut off, or of no kind it knows
        return None


def check_announced(
    size: tuple[int, int] | None, expected: tuple[int, int] | None, where: str
) -> None:
    """Raise HandtrackError for a picture larger than the calibration's before it is unpacked: a small file may fill the memory."""
    if size is not None and expected is not None and size[0] * size[1] > expected[0] * expected[1]:
        check_size(size, expected, where)


def check_size(found: tuple[int, int], expected: tuple[int, int] | None, where: str) -> None:
    """Raise HandtrackError unless an image has the calibration's size (width, height)."""
    if expected is not None and found != tuple(expected):
        what_to_do = "Use the images the calibration belongs to, or scale its matrix and size."
        factor = scaled_by(expected, found)
        if found == tuple(expected)[::-1]:
            what_to_do += (
                " Its sides are exchanged: was the camera turned, or does the file ask to be turned (EXIF orientation), "
                "which is done?"
            )
        elif factor is not None:
            what_to_do = (
                f"That is {factor:.4g} times as large: if the images were scaled, and not cut, say so by `image_size = "
                f"[{found[0]}, {found[1]}]` in the camera's table of session.toml (`handtrack new --scaled` writes it)."
            )
        raise HandtrackError(
            f"{where}: the image is {found[0]} x {found[1]}, but the camera is calibrated for "
            f"{expected[0]} x {expected[1]}. {what_to_do}"
        )


def _bytes(path: Path) -> tuple[bytes, str]:
    """Return a file's content, and what is wrong with it. Not cv2.imread, which fails on non-ASCII paths on Windows.

    Raises HandtrackError where the fault is ours: too many files are open.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        if error.errno in (errno.EMFILE, errno.ENFILE):
            raise HandtrackError(f"{path}: cannot be read ({error.strerror}).") from None
        return b"", f"cannot be read ({error.strerror})"
    if not data:
        return data, "the file is empty"
    # of what is cut off, some decoders fill the rest with black
    if data.startswith(_PNG) and b"IEND" not in data[-64:]:
        return data, "the PNG is cut off"
    # an end marker in the first half is an embedded thumbnail's
    if data.startswith(_JPEG) and data.rfind(b"\xff\xd9") < len(data) // 2:
        return data, "the JPEG is cut off"
    return data, ""


def _decoded(data: bytes, flags: int) -> Array | None:
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        if error.code == cv2.Error.StsNoMem:
            raise MemoryError(error.err) from None
        return None  # larger than OpenCV allows


def _mask(image: Array, path: Path) -> Bytes:
    """Return a mask as (H, W); grey pictures in colour are one. Raises HandtrackError for what only looks like a mask."""
    if image.ndim == 3 and image.shape[2] == 4 and (image[..., 3] != 255).any():
        raise HandtrackError(
            f"{path}: a mask must be one channel; this one has an alpha channel that is not opaque everywhere, so it is "
            "unclear which of them is the hand. Save masks as grey pictures: 0 background, 255 hand."
        )
    if image.dtype == np.uint8 and image.ndim == 3:
        image = cv2.cvtColor(image[..., :3], cv2.COLOR_BGR2GRAY)
    most = image.max()
    if image.dtype != np.uint8 or 0 < most < _LEAST_HAND:
        raise HandtrackError(
            f"{path}: a mask must be of 8 bits, 0 for background and 255 for hand; found {image.dtype}, the largest "
            f"value in the mask is {most}. Save the masks so, with hand at 255."
        )
    return image


def _oddities(data: bytes, image: Array, path: Path) -> Iterator[str]:
    """Yield what a colour image may not have been meant to be."""
    raw = _decoded(data, _AS_IT_IS)
    if raw is not None and raw.dtype == np.uint16 and raw.max() < _DIM_16:
        yield (
            f"{path}: a picture of 16 bits whose largest value is {raw.max()}; as the upper 8 bits are used, it is dark. "
            "If these are 10 or 12 bits, scale them to the whole range, or save 8 bits."
        )
    as_stored = _decoded(data, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if as_stored is not None and not np.array_equal(as_stored, image):
        yield (
            f"{path}: the file asks to be turned or mirrored (EXIF orientation), which is done, also when calibrating. If "
            "the calibration was made otherwise, take that mark out of the files."
        )
