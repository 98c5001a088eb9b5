"""Read videos by decode index, exact at random access, without holding the recording in memory.

What a container says about its frames is not trusted: the number of frames is counted by decoding
once, and a seek is used only where it is proven, by time stamp and by content, to have arrived
where it should.
"""

from __future__ import annotations

import threading
import zlib
from collections import OrderedDict
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from handtrack.arrays import D3, Array, H, W
from handtrack.capture.images.frames import check_size
from handtrack.errors import HandtrackError

_CACHE_BYTES = 64 << 20
_CHECKPOINT_EVERY = 250  # frames; what a far step back costs at most, beside the window
_UNEVEN = 1.5  # times the usual step between two frames


class _Checkpoint(NamedTuple):
    time_ms: float
    checksum: int


class VideoFile:
    """Frames (H, W, 3) uint8 BGR of a video; a frame is its decode index from 0.

    expected_size: (width, height) [px] of the calibration. Raises HandtrackError when the file
    cannot be opened as a video, holds no frame, or has another size.
    """

    def __init__(
        self, path: Path, expected_size: tuple[int, int] | None = None, where: str = ""
    ) -> None:
        self._path = Path(path)
        self._where = where or str(path)
        self._lock = threading.RLock()
        self._cache: OrderedDict[int, Array] = OrderedDict()
        self._count: int | None = None
        self._checkpoints: dict[int, _Checkpoint] = {}
        self._warnings: list[str] = []
        self._capture = self._open()
        self._next = 0  # decode index of the frame that the next grab gives
        first = self._decode_next()
        if first is None:
            raise HandtrackError(
                f"{self._where}: no frame can be decoded; the video is damaged or empty."
            )
        check_size(first, expected_size, self._where)
        self._size = (first.shape[1], first.shape[0])
        self._keep = max(8, _CACHE_BYTES // first.nbytes)
        self._remember(0, first)
        self.nominal_fps = float(self._capture.get(cv2.CAP_PROP_FPS))
        """what the container says [1/s]; 0 when it says nothing."""

    @property
    def where(self) -> str:
        return self._where

    @property
    def size(self) -> tuple[int, int] | None:
        return self._size

    @property
    def frames(self) -> range:
        """Every frame that can be decoded. The first use decodes the whole video once."""
        with self._lock:
            if self._count is None:
                self._count = self._audit()
            return range(self._count)

    @property
    def warnings(self) -> tuple[str, ...]:
        with self._lock:
            return tuple(self._warnings)

    def has(self, frame: int) -> bool:
        return frame in self.frames

    def read(self, frame: int) -> Array[H, W, D3] | None:
        if frame < 0:
            return None
        with self._lock:
            if frame in self._cache:
                self._cache.move_to_end(frame)
                return self._cache[frame]
            if self._count is not None and frame >= self._count:
                return None
            if frame < self._next:
                self._rewind(frame)
            elif frame - self._next > _CHECKPOINT_EVERY:
                self._jump(frame)
            return self._decode_to(frame)

    def close(self) -> None:
        """Give back the decoder and the cached frames; reading again starts anew."""
        with self._lock:
            self._capture.release()
            self._cache.clear()
            self._next = 1 << 62  # any frame lies before: the next read rewinds

    def _open(self) -> cv2.VideoCapture:
        if not self._path.is_file():
            raise HandtrackError(f"{self._where}: no such file; expected a video.")
        capture = cv2.VideoCapture(str(self._path))
        if not capture.isOpened():
            raise HandtrackError(
                f"{self._where}: cannot be opened as a video. It is no video, its codec is "
                "unknown, or it was cut off before its index was written; re-encode it (for "
                "instance with ffmpeg) or record again."
            )
        return capture

    def _decode_next(self) -> Array | None:
        if not self._capture.grab():
            return None
        self._next += 1  # also when the image is bad: it has its index
        good, image = self._capture.retrieve()
        return image if good else None

    def _decode_to(self, frame: int) -> Array | None:
        """Decode up to a frame at or after the position; the last ones on the way stay in the cache."""
        window = self._window
        while self._next < frame - window:
            if not self._capture.grab():
                return None
            self._next += 1
        while self._next <= frame:
            at = self._next
            image = self._decode_next()
            if image is not None:
                self._remember(at, image)
            if self._next == at:
                return None  # the video ends before the frame
        return self._cache.get(frame)

    @property
    def _window(self) -> int:
        """Frames kept before one that was stepped back to, for further steps back."""
        return self._keep // 2

    def _remember(self, frame: int, image: Array) -> None:
        image.flags.writeable = False
        self._cache[frame] = image
        while len(self._cache) > self._keep:
            self._cache.popitem(last=False)

    def _rewind(self, frame: int) -> None:
        """Place the decoder a window before `frame`, at a proven checkpoint or at the start."""
        if not self._seek_checkpoint(max(0, frame - self._window)):
            self._restart()

    def _jump(self, frame: int) -> None:
        """Place the decoder nearer to a frame far ahead, if a proven checkpoint lies between."""
        found = self._seek_checkpoint(max(0, frame - self._window), after=self._next)
        if not found and self._next < 0:  # the attempt lost the place
            self._restart()

    def _restart(self) -> None:
        self._capture.release()
        self._capture = self._open()
        self._next = 0

    def _seek_checkpoint(self, frame: int, after: int = 0) -> bool:
        """Seek to the last checkpoint in (after, frame]; true when time stamp and content prove it
        was reached."""
        usable = [at for at in self._checkpoints if after < at <= frame]
        if not usable:
            return False
        at = max(usable)
        self._next = -1  # unknown until proven
        if not self._capture.isOpened():
            self._capture = self._open()
        self._capture.set(cv2.CAP_PROP_POS_FRAMES, at)
        good, image = self._capture.read()
        if not good or self._mark(image) != self._checkpoints[at]:
            del self._checkpoints[at]
            return False
        self._next = at + 1
        self._remember(at, image)
        return True

    def _mark(self, image: Array) -> _Checkpoint:
        time_ms = float(self._capture.get(cv2.CAP_PROP_POS_MSEC))
        return _Checkpoint(time_ms, zlib.crc32(image.tobytes()))

    def _audit(self) -> int:
        """Decode everything once: count, note checkpoints, and say what is odd."""
        playing, self._capture = self._capture, self._open()
        claimed = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        times: list[float] = []
        while self._capture.grab():
            times.append(float(self._capture.get(cv2.CAP_PROP_POS_MSEC)))
            at = len(times) - 1
            if at and at % _CHECKPOINT_EVERY == 0:
                good, image = self._capture.retrieve()
                if good:
                    self._checkpoints[at] = self._mark(image)
        self._capture.release()
        self._capture = playing
        self._warnings += _oddities(self._where, claimed, np.array(times))
        return len(times)


def _oddities(where: str, claimed: int, times_ms: Array) -> list[str]:
    found: list[str] = []
    count = len(times_ms)
    if claimed > count:
        found.append(
            f"{where}: announces {claimed} frames, but only {count} can be decoded; it is cut off "
            f"or damaged. Frames from {count} on count as missing."
        )
    steps = np.diff(times_ms)
    if len(steps) > 2 and (usual := float(np.median(steps))) > 0:
        uneven = np.flatnonzero(steps > _UNEVEN * usual)
        if len(uneven):
            worst = int(uneven[np.argmax(steps[uneven])])
            found.append(
                f"{where}: {len(uneven)} steps between frames are longer than the usual "
                f"{usual:.1f} ms (the longest {steps[worst]:.0f} ms after frame {worst}); frames "
                "were dropped, or the rate varies. Give timestamps if cameras must agree."
            )
    return found
