"""VideoAudit: what decoding a whole video once tells, and the stamp by which it is known to be of this very file."""

from __future__ import annotations

import os
import threading
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from handtrack.arrays import Array, Axes, F, Floats, H, W
from handtrack.errors import HandtrackError

ENDING = threading.Event()
"""the program ends: no frames are counted any more. Python ends threads that still run, and within a decoder that aborts the program"""
_SAMPLE_BYTES = 1 << 16  # of a file's beginning and of its end, for its stamp
_UNEVEN = 1.5  # times the usual step between two frames


class Checkpoint(NamedTuple):
    """What is seen at a decode index: a seek that finds the same has arrived there."""

    time_ms: float
    checksum: int

    @classmethod
    def of(cls, capture: cv2.VideoCapture, image: Array[H, W, *Axes]) -> Checkpoint:
        """Return the mark of the image that was decoded last."""
        return cls(float(capture.get(cv2.CAP_PROP_POS_MSEC)), zlib.crc32(image.tobytes()))


@dataclass(frozen=True)
class VideoAudit:
    """Every frame of a video decoded once."""

    count: int
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
                    checkpoints[at] = Checkpoint.of(capture, image)
            if ENDING.is_set():
                raise HandtrackError("the program ended while a video's frames were counted.")
        return cls(len(times), checkpoints, tuple(oddities(announced, np.array(times))))


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


def oddities(announced: int, times_ms: Floats[F]) -> list[str]:
    """Return what is odd about a video's frames, in sentences: cut off, or unevenly spaced. times_ms: of all frames."""
    found: list[str] = []
    count = len(times_ms)
    if announced > count:
        found.append(
            f"announces {announced} frames, but only {count} can be decoded; it is cut off "
            f"or damaged. Frames from {count} on count as missing."
        )
    steps = np.diff(times_ms)
    if len(steps) > 2 and (usual := float(np.median(steps))) > 0:
        uneven = np.flatnonzero(steps > _UNEVEN * usual)
        if len(uneven):
            worst = int(uneven[np.argmax(steps[uneven])])
            found.append(
                f"{len(uneven)} steps between frames are longer than the usual "
                f"{usual:.1f} ms (the longest {steps[worst]:.0f} ms after frame {worst}); frames "
                "were dropped, or the rate varies. Give timestamps if cameras must agree."
            )
    return found
