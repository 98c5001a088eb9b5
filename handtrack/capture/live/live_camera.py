"""LiveCamera: one camera on a thread of its own, of which only the newest image counts."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import NamedTuple

from handtrack.arrays import D3, Array, H, W
from handtrack.capture.images.frames import check_size
from handtrack.capture.live.devices import Device
from handtrack.errors import HandtrackError

_PATIENCE = 3  # reads in a row without an image: then the camera is gone


class TimedImage(NamedTuple):
    """An image and when it came."""

    time_s: float
    """[s] of the clock"""
    image: Array[H, W, D3]


class LiveCamera:
    """Reads a device as fast as it gives images. An image that nobody took before the next one came is passed over."""

    def __init__(
        self,
        name: str,
        device: Device,
        size: tuple[int, int] | None = None,
        where: str = "",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Read one image, which shows that the device gives any, of the calibration's size (width, height) [px].

        Raises HandtrackError.
        """
        self.name, self.where = name, where or f"camera '{name}'"
        self._device, self._clock = device, clock
        first = device.read()
        if first is None:
            device.release()
            raise HandtrackError(
                f"{self.where}: it was opened, but gives no image. Is it in use by another program, or its lid closed? A "
                "video file must have a frame."
            )
        try:
            check_size(first, size, self.where)
        except HandtrackError:
            device.release()
            raise
        self.size = (first.shape[1], first.shape[0])
        self.fps = device.fps
        """images a second as the device says, 0 where it does not"""
        self.given, self.passed_over = 1, 0
        """images that came, and those of them that nobody took in time"""
        self.gone = ""
        """why no more images come, in a sentence; empty while they do"""
        self._newest: TimedImage | None = TimedImage(clock(), first)
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def has_new(self) -> bool:
        """Whether there is an image that nobody took; to be asked by who holds `changed`."""
        return self._newest is not None

    def take(self) -> TimedImage | None:
        """Return the newest image, once; for who holds `changed`."""
        newest, self._newest = self._newest, None
        return newest

    def start(self, changed: threading.Condition) -> None:
        """Begin to read; `changed` is notified of each image, and of the end."""
        read = threading.Thread(
            target=self._work, args=(changed,), name=f"camera {self.name}", daemon=True
        )
        self._thread = read
        read.start()

    def stop(self, timeout: float = 2.0) -> None:
        """End reading and give the device back."""
        self._stopping.set()
        if self._thread is None:
            self._device.release()
        else:
            self._thread.join(timeout)

    def _work(self, changed: threading.Condition) -> None:
        failures = 0
        while not self._stopping.is_set() and failures < _PATIENCE:
            image = self._device.read()
            fits = image is not None and (image.shape[1], image.shape[0]) == self.size
            failures = 0 if fits else failures + 1
            if fits and image is not None:
                with changed:
                    self.given += 1
                    self.passed_over += self._newest is not None
                    self._newest = TimedImage(self._clock(), image)
                    changed.notify_all()
        self._device.release()
        with changed:
            if not self._stopping.is_set():
                self.gone = (
                    f"{self.where} gives no more images: it was unplugged, or a file is at its end."
                )
            changed.notify_all()
