"""Cameras that a test runs by hand: they show an image when they are told to."""

import queue
import threading
from pathlib import Path

import numpy as np

from handtrack.arrays import Array
from tests.capture.sample_files import filmed

SIZE = (8, 6)


def image(value: int, size: tuple[int, int] = SIZE) -> Array:
    return np.full((size[1], size[0], 3), value, np.uint8)


class ScriptedDevice:
    """Gives an image when the test says so; a None is a read that fails."""

    fps = 30.0

    def __init__(self, first: Array | None = None) -> None:
        self._images: queue.Queue[Array | None] = queue.Queue()
        self._images.put(image(0) if first is None else first)
        self.asked = threading.Semaphore(0)
        self.released = False

    def read(self) -> Array | None:
        self.asked.release()
        return self._images.get()

    def release(self) -> None:
        self.released = True

    def show(self, value: int | Array) -> None:
        """Give an image, and return when the camera's thread has it."""
        self._images.put(image(value) if isinstance(value, int) else value)
        self.asked.acquire()

    def begin(self) -> None:
        """Return when the camera's thread waits for the second image; the first was read before it began."""
        self.asked.acquire()
        self.asked.acquire()

    def fail(self, times: int = 1) -> None:
        for _ in range(times):
            self._images.put(None)


def clip(path: Path, frames: int = 5, size: tuple[int, int] = (64, 48)) -> Path:
    """Write a video whose frame n is 40 n grey levels bright."""
    return filmed(path, (image(40 * frame, size) for frame in range(frames)), fps=20.0, size=size)
