"""A session's pins: the file pins.json, and before it what is not in the file yet."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from handtrack.errors import HandtrackError, unknown_name
from handtrack.files.atomic import write_over
from handtrack.files.text_files import read_json
from handtrack.files.toml_table import at_least, read_table
from handtrack.geometry.camera import CameraRig
from handtrack.observation.pins import ImagePins, Pin
from handtrack.session.layout import PINS_FILE, inside

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
