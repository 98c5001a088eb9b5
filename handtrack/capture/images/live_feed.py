"""LiveFeed: what running cameras, or video files played as if they were some, show, put together to frames one after the other."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import cv2

from handtrack.arrays import D3, Array, H, W, array_dataclass
from handtrack.capture.images.frames import check_size
from handtrack.errors import HandtrackError

_USUAL_FPS = 30.0


def open_device(
    device: str, size: tuple[int, int], where: str, rate: float, fps: float | None
) -> Device:
    """Return the device of an index such as `0`, of a path such as /dev/video2 or an address, or of
    a video file.

    Parameters
    ----------
    size
        Width, height [px] to ask a device for.
    rate
        How many times faster than its pace a file is played.
    fps
        Images a second to ask a device for.

    Raises
    ------
    HandtrackError
    """
    is_file = Path(device).is_file()
    is_index = device.isdecimal() and not is_file
    capture = cv2.VideoCapture(int(device)) if is_index else cv2.VideoCapture(device)
    if not capture.isOpened():
        raise HandtrackError(
            f"{where}: '{device}' cannot be opened as a camera; expected the number of a camera that is plugged in (0 is "
            "the first), its path or address, or a video file. Is it in use by another program, or may you not read it? "
            "Name another one with --camera NAME=DEVICE."
        )
    if is_file:
        return Device(capture, rate)
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
    if fps is not None:
        capture.set(cv2.CAP_PROP_FPS, fps)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # the newest image, not a queue of old ones
    return Device(capture)


class Device:
    """Gives one image after the other; read by one thread. Those of a file come when they are due: its first one at once, and its
    clock starts with the second.
    """

    def __init__(self, capture: cv2.VideoCapture, rate: float | None = None) -> None:
        """rate: how many times faster than its pace a file is played; None of what is no file."""
        self._capture, self._is_file = capture, rate is not None
        fps = max(float(capture.get(cv2.CAP_PROP_FPS)), 0.0)
        self.fps = fps if rate is None else (fps or _USUAL_FPS) * rate
        """images a second, 0 where unknown"""
        self._count, self._began = 0, 0.0
        self._released = threading.Event()

    def read(self) -> Array[H, W, D3] | None:
        """Wait for the next image uint8 BGR and return it; None where none comes."""
        good, image = self._capture.read()
        if self._count == 1:
            self._began = time.monotonic()
        if self._is_file and self._count > 1:
            due = self._began + (self._count - 1) / self.fps
            self._released.wait(max(due - time.monotonic(), 0.0))
        self._count += 1
        return image if good and not self._released.is_set() else None

    def release(self) -> None:
        """Give the device back; a read that waits may return."""
        self._released.set()
        if not self._is_file:
            self._capture.release()


_PATIENCE = 3  # reads in a row without an image: then the camera is gone


class LiveCamera:
    """Reads a device as fast as it gives images. An image that nobody took before the next one came is passed over."""

    def __init__(
        self,
        name: str,
        device: Device,
        size: tuple[int, int] | None,
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
        self.size = (first.shape[1], first.shape[0])
        try:
            check_size(self.size, size, self.where)
        except HandtrackError:
            device.release()
            raise
        self.fps = device.fps
        """images a second as the device says, 0 where it does not"""
        self.given, self.passed_over = 1, 0
        """images that came, and those of them that nobody took in time"""
        self.gone = ""
        """why no more images come, in a sentence; empty while they do"""
        self._newest: tuple[float, Array] | None = clock(), first
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def has_new(self) -> bool:
        """Whether there is an image that nobody took; to be asked by who holds `changed`."""
        return self._newest is not None

    def take(self) -> tuple[float, Array[H, W, D3]] | None:
        """Return the newest image and when it came [s], once; for who holds `changed`."""
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
                    self._newest = self._clock(), image
                    changed.notify_all()
        self._device.release()
        with changed:
            if not self._stopping.is_set():
                self.gone = (
                    f"{self.where} gives no more images: it was unplugged, or a file is at its end."
                )
            changed.notify_all()


_KEPT_IMAGES = 40  # frames whose images stay in memory: a search may have the last 32 solved anew
_KEPT_TIMES = 600  # frames that count as known
_STALLED_S = 1.0  # without any image; then a frame without images lets who tracks go on


@array_dataclass
class LiveFrame:
    """What the cameras showed at about one moment."""

    number: int
    time_s: float
    """of the newest image, since the feed began [s]"""
    images: Mapping[str, Array[H, W, D3]]
    """by camera; a camera that gave none in time is absent"""
    connected: tuple[str, ...] = ()
    """cameras that had not gone by then"""


class LiveFeed:
    """Cameras read beside. A frame is made when somebody asks for the next one: of each camera's newest image.

    It waits until every camera has a new image, but not longer than the tolerance after the first; an image older than
    the newest by more than the tolerance is left out. Safe from several threads.
    """

    def __init__(self, cameras: Sequence[LiveCamera], tolerance_s: float) -> None:
        self.cameras, self._tolerance_s = cameras, tolerance_s
        self.on_frame: Callable[[LiveFrame], None] | None = None
        """is told of each frame made, in order"""
        self.counts = {camera.name: Counter[str]() for camera in cameras}
        """what became of each one's images since counting began: `used`; `dropped`, which came while an earlier frame was still worked
        on; and `missing`, frames in which it had none within the tolerance
        """
        self._changed, self._making = threading.Condition(), threading.RLock()
        self._frames, self._times = dict[int, LiveFrame](), dict[int, float]()
        self._made = 0
        self._zero_s: float | None = None
        """of the clock, when the first frame was taken"""

    def start(self) -> None:
        """Begin to read all cameras."""
        for camera in self.cameras:
            camera.start(self._changed)

    def close(self) -> None:
        """End reading."""
        for camera in self.cameras:
            camera.stop(0.0)  # all of them are asked before one is waited for
        for camera in self.cameras:
            camera.stop()

    @property
    def known(self) -> range:
        """The frames made so far; the oldest are forgotten."""
        return range(max(self._made - _KEPT_TIMES, 0), self._made)

    @property
    def with_images(self) -> range:
        """Those of them whose images are still there."""
        return range(max(self._made - _KEPT_IMAGES, 0), self._made)

    @property
    def gone(self) -> tuple[str, ...]:
        """Why cameras give no more images, one sentence each."""
        return tuple(camera.gone for camera in self.cameras if camera.gone)

    def time_s(self, frame: int) -> float | None:
        """Return when a known frame was taken, since the feed began [s]."""
        return self._times.get(frame)

    def image(self, name: str, frame: int) -> Array[H, W, D3] | None:
        """Return a camera's image of a frame uint8 BGR; None where it had none, or it is forgotten."""
        kept = self._frames.get(frame)
        return None if kept is None else kept.images.get(name)

    def begin_counting(self) -> None:
        """Count from now on; images that wait are passed over, so that the next frame is new."""
        with self._changed:
            for camera in self.cameras:
                camera.passed_over = 0
                camera.take()
            self.counts = {camera.name: Counter[str]() for camera in self.cameras}

    def reach(self, frame: int) -> None:
        """Make frames until there is this one. A frame without images where no camera gives any for a while.

        Raises HandtrackError once all cameras are gone.
        """
        with self._making:
            while self._made <= frame:
                if self.make_next(_STALLED_S) is not None:
                    continue
                if all(camera.gone for camera in self.cameras):
                    raise HandtrackError(" ".join(self.gone))
                self._add({}, time.monotonic(), counts=True)

    def make_next(self, timeout_s: float, counts: bool = True) -> LiveFrame | None:
        """Make a frame of the newest images; None where no camera gave one for so long [s]."""
        with self._making:
            with self._changed:
                cameras = self.cameras
                self._changed.wait_for(
                    lambda: any(c.has_new for c in cameras) or all(c.gone for c in cameras),
                    timeout_s,
                )
                if not any(c.has_new for c in cameras):
                    return None
                self._changed.wait_for(
                    lambda: all(c.has_new or c.gone for c in cameras), self._tolerance_s
                )
                taken = {camera.name: camera.take() for camera in self.cameras}
            timed = {name: image for name, image in taken.items() if image is not None}
            newest = max(time_s for time_s, _ in timed.values())
            images = {
                name: image
                for name, (time_s, image) in timed.items()
                if newest - time_s <= self._tolerance_s
            }
            return self._add(images, newest, counts)

    def _add(self, images: Mapping[str, Array], clock_s: float, counts: bool) -> LiveFrame:
        if self._zero_s is None:
            self._zero_s = clock_s
        connected = tuple(camera.name for camera in self.cameras if not camera.gone)
        # two frames may not have one time
        last = next(reversed(self._times.values()), -1.0)
        made = LiveFrame(
            self._made, max(clock_s - self._zero_s, last + 1e-6, 0.0), images, connected
        )
        for camera in self.cameras:
            with self._changed:
                passed, camera.passed_over = camera.passed_over, 0
            if counts:
                count = self.counts[camera.name]
                count["dropped"] += passed
                count["used"] += camera.name in images
                count["missing"] += camera.name not in images and not camera.gone
        self._frames[made.number], self._times[made.number] = made, made.time_s
        self._frames.pop(made.number - _KEPT_IMAGES, None)
        self._times.pop(made.number - _KEPT_TIMES, None)
        self._made += 1
        if self.on_frame is not None:
            self.on_frame(made)
        return made


class LiveImages:
    """One camera of a feed as a source of images; see capture.images.frames.FrameSource."""

    def __init__(self, feed: LiveFeed, camera: LiveCamera) -> None:
        self._feed, self._camera = feed, camera
        self.where, self.size = camera.where, camera.size

    @property
    def frames(self) -> range:
        return self._feed.known

    @property
    def known_frames(self) -> range:
        return self._feed.known

    @property
    def warnings(self) -> tuple[str, ...]:
        return (self._camera.gone,) if self._camera.gone else ()

    def has(self, frame: int) -> bool:
        return self._feed.image(self._camera.name, frame) is not None

    def read(self, frame: int) -> Array[H, W, D3] | None:
        return self._feed.image(self._camera.name, frame)
