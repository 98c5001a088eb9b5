"""Read videos by decode index, exact at random access, without holding the recording in memory.

What a container says about its frames is not trusted: who must know how many there are waits until they are counted
by decoding once, and a seek is used only where it is proven, by time stamp and by content, to have
arrived where it should.
"""

from __future__ import annotations

import os
import threading
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta

from handtrack.arrays import D3, Array, Axes, F, Floats, H, W
from handtrack.capture.images.containers import check_container
from handtrack.capture.images.frames import check_announced, check_size
from handtrack.errors import HandtrackError
from handtrack.parallel import LRUCache

ENDING = threading.Event()
"""the program ends: no frames are counted any more. Python ends threads that still run, and within a decoder that aborts the program"""
_SAMPLE_BYTES = 1 << 16  # of a file's beginning and of its end, for its stamp
_UNEVEN = 1.5  # times the usual step between two frames


Checkpoint = tuple[float, int]
"""time [ms] and checksum of the image at a decode index: a seek that finds the same has arrived there"""


@dataclass(frozen=True)
class VideoAudit:
    """Every frame of a video decoded once."""

    count: Annotated[int, Meta(ge=1)]
    """frames that can be decoded"""
    checkpoints: Mapping[int, Checkpoint]
    """by decode index"""
    oddities: tuple[str, ...]
    """in sentences, without the file's name"""

    @classmethod
    def of(cls, capture: cv2.VideoCapture, every: int) -> VideoAudit:
        """Return the audit of a video just opened, with a checkpoint every so many frames. Raises HandtrackError where the program ends
        meanwhile (`ENDING`).
        """
        announced = announced_frames(capture)
        times: list[float] = []
        checkpoints: dict[int, Checkpoint] = {}
        while capture.grab():
            at = len(times)
            times.append(float(capture.get(cv2.CAP_PROP_POS_MSEC)))
            if at and at % every == 0:
                good, image = capture.retrieve()
                if good:
                    checkpoints[at] = _checkpoint(capture, image)
            if ENDING.is_set():
                raise HandtrackError("the program ended while a video's frames were counted.")
        return cls(len(times), checkpoints, tuple(oddities(announced, np.array(times))))


def _checkpoint(capture: cv2.VideoCapture, image: Array[H, W, *Axes]) -> Checkpoint:
    """Return the mark of the image that was decoded last."""
    return float(capture.get(cv2.CAP_PROP_POS_MSEC)), zlib.crc32(image.tobytes())


def announced_frames(capture: cv2.VideoCapture) -> int:
    """Return how many frames the container says it has; 0 where it says nothing of use."""
    return max(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)


def file_stamp(path: Path) -> str:
    """Return a file's size, time of change and a checksum of its two ends: another stamp is another file.

    Raises OSError.
    """
    with path.open("rb") as file:
        about = os.fstat(file.fileno())
        digest = zlib.crc32(file.read(_SAMPLE_BYTES))
        file.seek(max(about.st_size - _SAMPLE_BYTES, 0))
        digest = zlib.crc32(file.read(_SAMPLE_BYTES), digest)
    return f"{about.st_size}-{about.st_mtime_ns}-{digest:08x}"


def oddities(announced: int, times_ms: Floats[F]) -> Iterator[str]:
    """Yield what is odd about a video's frames, in sentences: cut off, or unevenly spaced. times_ms: of all frames."""
    count = len(times_ms)
    if announced > count:
        yield (
            f"announces {announced} frames, but only {count} can be decoded; it is cut off "
            f"or damaged. Frames from {count} on count as missing."
        )
    steps = np.diff(times_ms)
    if len(steps) > 2 and (usual := float(np.median(steps))) > 0:
        uneven = np.flatnonzero(steps > _UNEVEN * usual)
        if len(uneven):
            worst = int(uneven[np.argmax(steps[uneven])])
            yield (
                f"{len(uneven)} steps between frames are longer than the usual "
                f"{usual:.1f} ms (the longest {steps[worst]:.0f} ms after frame {worst}); frames "
                "were dropped, or the rate varies. Give timestamps if cameras must agree."
            )


_CACHE_BYTES = 64 << 20
_ONWARD = 16  # frames kept while reading goes on: a page shows those that are just tracked
_TURNED = (
    "asks to be turned by {}°, which is done, also when calibrating. If the calibration was made otherwise, take that mark out "
    "of the file."
)
_MOST_ANNOUNCED = 10_000_000  # days of video: a container that says more is counted at once
_OPEN_MS = 10_000  # of a sound file it takes some ms; FFmpeg looks through all of a damaged one for a beginning
_CHECKPOINT_EVERY = 250  # frames; what a far step back costs at most, beside the window


class VideoFile:
    """Frames (H, W, 3) uint8 BGR of a video; a frame is its decode index from 0.

    expected_size: (width, height) [px] of the calibration. audit: of this file, where it was made before. Raises
    HandtrackError when the file cannot be opened as a video, holds no frame, or has another size.
    """

    def __init__(
        self,
        path: Path,
        expected_size: tuple[int, int] | None = None,
        where: str = "",
        audit: VideoAudit | None = None,
    ) -> None:
        self.path = Path(path)
        self.where = where or str(path)
        self._lock, self._counting = threading.RLock(), threading.Lock()
        self._cache = LRUCache[int, Array]()
        self.audit = audit
        """what decoding everything told; None until it was done"""
        self._checkpoints = dict(audit.checkpoints) if audit is not None else {}
        self._capture = self._open()
        sides = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        width, height = (int(self._capture.get(side)) for side in sides)
        check_announced((width, height), expected_size, self.where)
        self._next = 0  # decode index of the frame that the next grab gives
        first = self._decode_next()
        if first is None:
            raise HandtrackError(
                f"{self.where}: no frame can be decoded. The video is empty or damaged, or OpenCV cannot decode its codec on this "
                "computer, as often with AV1; re-encode it (for instance with ffmpeg)."
            )
        self._announced = announced_frames(self._capture)
        self.size = (first.shape[1], first.shape[0])
        check_size(self.size, expected_size, self.where)
        self._most = max(8, _CACHE_BYTES // first.nbytes)
        self._keep = min(_ONWARD, self._most)
        """frames kept, half of them before the one that is read: more where it was stepped back to, for further steps back"""
        self._remember(0, first)
        self.nominal_fps = float(self._capture.get(cv2.CAP_PROP_FPS))
        """what the container says [1/s]; 0 when it says nothing."""
        turn = int(self._capture.get(cv2.CAP_PROP_ORIENTATION_META))
        self._turned = (_TURNED.format(turn),) if turn in (90, 180, 270) else ()

    @property
    def frames(self) -> range:
        """Every frame that can be decoded. Unless that is known, the whole video is decoded once; reading goes on."""
        return range(self.audited().count)

    @property
    def known_frames(self) -> range:
        """The same as far as is known without decoding: what the container announces, until they were counted."""
        known = self.audit
        if known is None and not 0 < self._announced <= _MOST_ANNOUNCED:
            return self.frames
        return range(self._announced if known is None else known.count)

    def audited(self) -> VideoAudit:
        """Return the audit, made if need be, beside who reads."""
        with self._counting:
            if self.audit is None:
                capture = self._open()
                audit = VideoAudit.of(capture, _CHECKPOINT_EVERY)
                capture.release()
                with self._lock:
                    self._checkpoints = dict(audit.checkpoints)
                    self.audit = audit
            return self.audit

    @property
    def warnings(self) -> tuple[str, ...]:
        known = self.audit
        found = self._turned if known is None else (*self._turned, *known.oddities)
        return tuple(f"{self.where}: {text}" for text in found)

    def has(self, frame: int) -> bool:
        return frame in self.frames

    def read(self, frame: int) -> Array[H, W, D3] | None:
        if frame < 0:
            return None
        with self._lock:
            if (cached := self._cache.get(frame)) is not None:
                return cached
            if self.audit is not None and frame >= self.audit.count:
                return None
            self._keep = self._most if frame < self._next else min(_ONWARD, self._most)
            if not 0 <= frame - self._next <= _CHECKPOINT_EVERY:
                self._seek(frame)
            return self._decode_to(frame)

    def close(self) -> None:
        """Give back the decoder and the cached frames; reading again starts anew."""
        with self._lock:
            self._capture.release()
            self._cache.clear()
            self._next = 1 << 62  # any frame lies before: the next read rewinds

    def _open(self) -> cv2.VideoCapture:
        check_container(self.path, self.where)
        capture = cv2.VideoCapture(
            str(self.path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _OPEN_MS]
        )
        if not capture.isOpened():
            raise HandtrackError(
                f"{self.where}: cannot be opened as a video. Its codec is unknown, it is damaged, or it was cut off before its "
                "index was written; re-encode it (for instance with ffmpeg) or record again."
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
        while self._next < frame - self._keep // 2:
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

    def _remember(self, frame: int, image: Array) -> None:
        image.flags.writeable = False
        self._cache.put(frame, image, self._keep)

    def _seek(self, frame: int) -> None:
        """Place the decoder at the last checkpoint a window before `frame`, where time stamp and content prove that it was reached; else
        at the start, unless it is before the frame.
        """
        after = self._next if self._next <= frame else 0
        usable = (at for at in self._checkpoints if after < at <= frame - self._keep // 2)
        if at := max(usable, default=0):
            self._next = -1  # unknown until proven
            if not self._capture.isOpened():
                self._capture = self._open()
            self._capture.set(cv2.CAP_PROP_POS_FRAMES, at)
            good, image = self._capture.read()
            if good and _checkpoint(self._capture, image) == self._checkpoints[at]:
                self._next = at + 1
                self._remember(at, image)
                return
            del self._checkpoints[at]
        if not 0 <= self._next <= frame:  # an attempt loses the place
            self._capture.release()
            self._capture = self._open()
            self._next = 0
