"""What a camera is read from: a device, or a video file that is played at its own pace as if it were one."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import cv2

from handtrack.arrays import D3, Array, H, W
from handtrack.errors import HandtrackError

_USUAL_FPS = 30.0


class Device(Protocol):
    """Gives one image after the other; read by one thread."""

    fps: float
    """images a second, 0 where unknown"""

    def read(self) -> Array[H, W, D3] | None:
        """Wait for the next image uint8 BGR and return it; None where none comes."""
        ...

    def release(self) -> None:
        """Give the device back; a read that waits may return."""
        ...


def open_device(
    device: str, size: tuple[int, int], where: str, rate: float = 1.0, fps: float | None = None
) -> Device:
    """Return the device of an index such as `0`, of a path such as /dev/video2 or an address, or of a video file.

    size: width, height [px] to ask a device for. rate: how many times faster than its pace a file is played. fps: images
    a second to ask a device for. Raises HandtrackError.
    """
    if Path(device).is_file():
        return PlayedFile(_opened(cv2.VideoCapture(device), device, where), rate)
    capture = cv2.VideoCapture(int(device)) if device.isdecimal() else cv2.VideoCapture(device)
    capture = _opened(capture, device, where)
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
    if fps is not None:
        capture.set(cv2.CAP_PROP_FPS, fps)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # the newest image, not a queue of old ones
    return CaptureDevice(capture)


class CaptureDevice:
    """A device of OpenCV."""

    def __init__(self, capture: cv2.VideoCapture) -> None:
        self._capture = capture
        self.fps = max(float(capture.get(cv2.CAP_PROP_FPS)), 0.0)

    def read(self) -> Array[H, W, D3] | None:
        good, image = self._capture.read()
        return image if good else None

    def release(self) -> None:
        self._capture.release()


class PlayedFile(CaptureDevice):
    """A video whose images come when they are due; its first one comes at once, and starts its clock with the second."""

    def __init__(
        self,
        capture: cv2.VideoCapture,
        rate: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(capture)
        self.fps = (self.fps or _USUAL_FPS) * rate
        self._clock, self._count, self._began = clock, 0, 0.0
        self._released = threading.Event()

    def read(self) -> Array[H, W, D3] | None:
        image = super().read()
        if self._count == 1:
            self._began = self._clock()
        if self._count > 1:
            due = self._began + (self._count - 1) / self.fps
            self._released.wait(max(due - self._clock(), 0.0))
        self._count += 1
        return None if self._released.is_set() else image

    def release(self) -> None:
        self._released.set()


def _opened(capture: cv2.VideoCapture, device: str, where: str) -> cv2.VideoCapture:
    if not capture.isOpened():
        raise HandtrackError(
            f"{where}: '{device}' cannot be opened as a camera; expected the number of a camera that is plugged in (0 is "
            "the first), its path or address, or a video file. Is it in use by another program, or may you not read it? "
            "Name another one with --camera NAME=DEVICE."
        )
    return capture
