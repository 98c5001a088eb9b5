"""What a person said about a recording's frames: masks painted over, and pins. Files, and before them what is not in files yet."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from msgspec import Meta

from handtrack.arrays import Array, Bytes, H, W
from handtrack.capture.masks.mask_correction import AS_IT_IS, LEVELS, corrected
from handtrack.errors import HandtrackError, unknown_name
from handtrack.files.atomic import write_over
from handtrack.files.text_files import read_json
from handtrack.files.toml_table import at_least, read_table
from handtrack.geometry.camera import CameraRig
from handtrack.observation.pins import ImagePins, Pin
from handtrack.session.layout import CORRECTED_FOLDER, PINS_FILE, inside

# ---- Corrections of a camera's masks: where they say something, they win over files and methods


class CorrectedMasks:
    """A camera's corrections by its own frames: files, and before them what is not in files yet. Safe from several threads."""

    def __init__(self, folder: Path, camera: str, size: tuple[int, int], has_files: bool) -> None:
        """size: width, height [px] of the camera's images. has_files: those of a running camera are about a recording's frames."""
        self._root, self._camera, self._size = folder, camera, size
        self._has_files = has_files
        self._held: dict[int, bytes | None] = {}
        self._lock = threading.Lock()

    def hold(self, frame: int, content: bytes | None) -> None:
        """Let a correction, as `encoded` gives it, count before what stands in files; None: none counts."""
        with self._lock:
            self._held[frame] = content

    def content(self, frame: int) -> bytes | None:
        """Return a frame's correction as a PNG file has it; None where nobody corrected it. Raises HandtrackError."""
        with self._lock:
            if frame in self._held:
                return self._held[frame]
        path = self.path(frame) if self._has_files else None
        return path.read_bytes() if path is not None and path.is_file() else None

    def layer(self, frame: int) -> Bytes[H, W] | None:
        """Return a frame's correction: 255 hand, 0 background, UNKNOWN_LEVEL nobody knows, AS_IT_IS not corrected; None where
        nobody corrected it. Raises HandtrackError for a file that is none.
        """
        content = self.content(frame)
        return None if content is None else decoded(content, self._size, str(self.path(frame)))

    def over(self, frame: int, mask: Bytes[H, W] | None, unknown: int) -> Bytes[H, W] | None:
        """Return a frame's mask with its correction painted over it; the same mask where nobody
        corrected it.

        Parameters
        ----------
        unknown
            The value of the result where nobody knows.
        """
        layer = self.layer(frame)
        return mask if layer is None else corrected(layer, mask, unknown)

    def write(self, frame: int, content: bytes | None, ours: bytes | None) -> bool:
        """Write or (None) remove the file of a correction; see `write_over`."""
        return write_over(self.path(frame), content, ours)

    def path(self, frame: int) -> Path:
        """Return where the file of a frame lies, if there is one. Raises HandtrackError where that leaves the session."""
        return inside(
            self._root, f"{CORRECTED_FOLDER}/{self._camera}/{frame:06d}.png", str(self._root)
        )

    @property
    def frames(self) -> list[int]:
        """The camera's own frames that are corrected."""
        files = self.path(0).parent.glob("*.png") if self._has_files else ()
        found = {int(path.stem) for path in files if path.stem.isdecimal()}
        with self._lock:
            held = dict(self._held)
        return sorted(
            {f for f in found if f not in held} | {f for f, c in held.items() if c is not None}
        )


def encoded(layer: Bytes[H, W]) -> bytes | None:
    """Return a layer as a PNG file; None for one that says nothing."""
    if (layer == AS_IT_IS).all():
        return None
    good, buffer = cv2.imencode(".png", layer)
    assert good, "a PNG is always made"
    return buffer.tobytes()


def decoded(content: bytes, size: tuple[int, int], where: str) -> Bytes[H, W]:
    """Return the layer of a PNG file. Raises HandtrackError, naming `where`, for another size or other levels."""
    image: Array | None = None
    if content:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    wanted = f"a grey PNG of {size[0]} x {size[1]} with the levels {', '.join(map(str, LEVELS))}"
    if image is None:
        raise HandtrackError(
            f"{where}: no image that can be read; expected a correction of masks, {wanted}."
        )
    if image.dtype != np.uint8 or image.shape != (size[1], size[0]):
        raise HandtrackError(
            f"{where}: found an image {image.shape} of {image.dtype}; expected {wanted}."
        )
    others = np.setdiff1d(image, LEVELS)
    if len(others):
        raise HandtrackError(
            f"{where}: found the level {others[0]}; expected {wanted}: background, not corrected, unknown, hand."
        )
    return np.asarray(image, np.uint8)  # type: ignore[return-value]


# ---- Pins


_FORMAT = 1
_DIGITS = 3  # of a pixel: a thousandth of one


@dataclass(frozen=True)
class _PinRow:
    """A pin as the file has it."""

    frame: Annotated[int, at_least(0)]
    camera: str
    pixel: Annotated[tuple[float, float], Meta(description="2 numbers")]
    joint: str = ""
    bone: str = ""
    point_m: Annotated[tuple[float, float, float], Meta(description="3 numbers")] | None = None

    def __post_init__(self) -> None:
        if bool(self.joint) == bool(self.bone) or bool(self.bone) != bool(self.point_m):
            raise ValueError('expected either "joint", or "bone" with "point_m".')


class SessionPins:
    """Where a person said that joints and segments lie, by frame. Safe from several threads."""

    def __init__(self, folder: Path, rig: CameraRig, has_file: bool = True) -> None:
        """has_file: those of running cameras are about a recording's frames. Raises HandtrackError for a file that is none."""
        self._path = inside(folder, PINS_FILE, str(folder))
        self._see_by(rig)
        self._lock = threading.Lock()
        self._pins: dict[int, tuple[Pin, ...]] = {}
        if has_file and self._path.is_file():
            self._pins = self._read()
        self._in_file = dict(self._pins)

    def _see_by(self, rig: CameraRig) -> None:
        self._rig = rig
        self._flat = {camera.name: camera.without_distortion() for camera in rig}

    def with_cameras(self, rig: CameraRig) -> SessionPins:
        """Return the same pins, now and later, by cameras of another calibration."""
        changed = copy(self)
        changed._see_by(rig)
        return changed

    def of(self, frame: int) -> tuple[Pin, ...]:
        """Return a frame's pins."""
        with self._lock:
            return self._pins.get(frame, ())

    @property
    def frames(self) -> list[int]:
        """The frames that have pins."""
        with self._lock:
            return sorted(self._pins)

    def observed(self, frame: int) -> tuple[ImagePins, ...]:
        """Return a frame's pins as they are observed, by camera."""
        return self.as_observed(self.of(frame))

    def as_observed(self, pins: Iterable[Pin]) -> tuple[ImagePins, ...]:
        """Return any pins as they are observed."""
        by_camera: dict[str, list[Pin]] = {}
        for pin in pins:
            by_camera.setdefault(pin.camera, []).append(pin)
        return tuple(ImagePins(self._flat[name], tuple(own)) for name, own in by_camera.items())

    def as_written(self, pin: Pin) -> Pin:
        """Return a pin as it is read from the file: whoever opens the session tracks by the same numbers. Raises HandtrackError."""
        return self._pin(self._row(0, pin), "a pin")[1]

    def hold(self, frame: int, pins: Iterable[Pin]) -> None:
        """Let pins of a frame count from now on; none: no pins. The file is written by `write`."""
        pins = tuple(pins)
        with self._lock:
            if pins:
                self._pins[frame] = pins
            else:
                self._pins.pop(frame, None)

    def write(
        self, changed: Mapping[int, Iterable[Pin] | None], kept: str | None = None
    ) -> str | None:
        """Write what changed of the pins to the file; without pins there is none.

        Return its text.

        Parameters
        ----------
        changed
            By frame; None: no pins.
        kept
            What was written here last: a file that is otherwise is kept in versions/.

        Raises
        ------
        HandtrackError
        """
        for frame, pins in changed.items():
            self._in_file[frame] = tuple(map(self.as_written, pins or ()))
        text = self.text_of(self._in_file)
        write_over(self._path, *(None if one is None else one.encode() for one in (text, kept)))
        return text

    @property
    def text(self) -> str | None:
        """The text of a file of the pins that count; None without pins."""
        with self._lock:
            return self.text_of(self._pins)

    def text_of(self, by_frame: Mapping[int, tuple[Pin, ...]]) -> str | None:
        """Return the text of a file of pins by frame; None without pins."""
        pins = [(frame, pin) for frame in sorted(by_frame) for pin in by_frame[frame]]
        if not pins:
            return None
        rows = ",\n".join("  " + json.dumps(self._row(*of)) for of in pins)
        return f'{{"format": {_FORMAT}, "unit": "px", "pins": [\n{rows}\n]}}\n'

    def _row(self, frame: int, pin: Pin) -> dict[str, object]:
        """Return a pin as the file has it, in the image as it was taken."""
        row: dict[str, object] = {"frame": frame, "camera": pin.camera}
        row |= {"joint": pin.joint} if pin.joint else {"bone": pin.bone, "point_m": list(pin.point)}
        taken = self._rig[pin.camera].distort_points(np.array(pin.pixel))
        return row | {"pixel": [round(float(x), _DIGITS) for x in taken]}

    def _read(self) -> dict[int, tuple[Pin, ...]]:
        data = read_json(self._path, "pins")
        if not isinstance(data, dict) or not isinstance(data.get("pins"), list):
            raise HandtrackError(
                f'{self._path}: expected {{"format": 1, "unit": "px", "pins": [...]}}, as the workbench writes it.'
            )
        if data.get("format", _FORMAT) != _FORMAT:
            raise HandtrackError(
                f"{self._path}: format {data['format']!r}; this version reads format {_FORMAT}."
            )
        found: dict[int, tuple[Pin, ...]] = {}
        for number, row in enumerate(data["pins"]):
            frame, pin = self._pin(row, f"{self._path}: pin {number}")
            found[frame] = (*found.get(frame, ()), pin)
        return found

    def _pin(self, row: Any, where: str) -> tuple[int, Pin]:
        read = read_table(_PinRow, row, where)
        if read.camera not in self._rig:
            raise unknown_name("camera", read.camera, self._rig.names, where)
        flat = self._rig[read.camera].undistort_points(np.array(read.pixel))
        if not np.isfinite(flat).all():
            raise HandtrackError(
                f"{where}: pixel = {list(read.pixel)} lies where the lens of {read.camera} cannot have put anything."
            )
        pixel, point = (float(flat[0]), float(flat[1])), read.point_m or (0.0, 0.0, 0.0)
        return read.frame, Pin(read.camera, pixel, read.joint, read.bone, point)
