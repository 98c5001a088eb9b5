"""Which of a camera's own frames shows the moment of a session's frame: a camera may be late, have a rate of its own, or miss frames."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from pathlib import Path

import numpy as np

from handtrack.arrays import Floats, N, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.files.text_files import read_rows, read_text
from handtrack.session.layout import SESSION_FILE, matching_files
from handtrack.session.session_file import CameraSettings, RecordingSettings

COLUMNS = ("camera", "frame", "time_s")
_UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
_LONG_STEP_S = 5.0  # from frame to frame, where no fps says that it is so
_USUAL_STEP_S = (0.001, 1.0)
_TIE = 1e-3  # of a frame: two that are equally near but for rounding


@array_dataclass
class FrameTimes:
    """Time of every frame: frame / fps, or measured times with straight lines between and beyond them."""

    fps: float
    """frames a second; the median rate when only times were given."""
    frame: Floats[N] = field(default_factory=lambda: np.zeros(1))
    """frames with a measured time, ascending; the first alone where there is but a rate."""
    time_s: Floats[N] = field(default_factory=lambda: np.zeros(1))
    """[s], ascending."""

    def time_of(self, frame: int) -> float:
        """Return a frame's time [s]."""
        if frame < self.frame[0]:
            return float(self.time_s[0] + (frame - self.frame[0]) / self.fps)
        if frame > self.frame[-1]:
            return float(self.time_s[-1] + (frame - self.frame[-1]) / self.fps)
        return float(np.interp(frame, self.frame, self.time_s))

    def nearest(self, time_s: float) -> int:
        """Return the frame whose time is nearest, the earlier of two; below 0 where time_s lies before them all."""
        frame, times = self.frame, self.time_s
        if time_s < times[0]:
            place = frame[0] + (time_s - times[0]) * self.fps
        elif time_s > times[-1]:
            place = frame[-1] + (time_s - times[-1]) * self.fps
        else:
            place = np.interp(time_s, times, frame)
        before = math.floor(place)
        gaps = time_s - self.time_of(before), self.time_of(before + 1) - time_s
        return before + (gaps[1] < gaps[0] - _TIE / self.fps)

    def later(self, by_s: float) -> FrameTimes:
        """Return the same frames at times that are later by some seconds; of a rate alone they begin there."""
        return FrameTimes(self.fps, self.frame, self.time_s + by_s)


def read_timestamps(path: Path, rates: Mapping[str, float | None]) -> dict[str, FrameTimes]:
    """Return the times by camera of a csv with the columns camera, frame, time_s, of those that are
    in it.

    Parameters
    ----------
    rates
        Frames a second of each of the session's cameras, None where only the times tell.

    Raises
    ------
    HandtrackError
        Naming the line.
    """
    times: dict[str, dict[int, float]] = {}
    head, *rows = read_rows(read_text(path, "times of frames"), str(path), ",") or [[]]
    if [name.strip() for name in head] != list(COLUMNS):
        raise HandtrackError(
            f"{path}: the columns are {','.join(head) or 'missing'}; expected {','.join(COLUMNS)}."
        )
    for number, row in enumerate(rows, 2):
        where = f"{path}, line {number}"
        try:
            name, frame, time_s = row[0].strip(), int(row[1]), float(row[2])
            if len(row) > 3:  # a decimal comma
                raise ValueError
        except (IndexError, ValueError):
            if not row:
                continue
            raise HandtrackError(
                f"{where}: '{','.join(row)}'; expected a camera, a whole frame number and seconds."
            ) from None
        if name not in rates:
            raise HandtrackError(f"{where}: unknown camera '{name}'; known: {', '.join(rates)}.")
        if frame < 0 or not math.isfinite(time_s):
            raise HandtrackError(
                f"{where}: frame {frame}, time {time_s}; expected a frame from 0 and finite seconds."
            )
        if frame in times.setdefault(name, {}):
            raise HandtrackError(f"{where}: a second time for camera '{name}', frame {frame}.")
        times[name][frame] = time_s
    if not times:
        raise HandtrackError(f"{path}: times of 0 frames; expected at least two.")
    return {
        name: _of_camera(f"{path}, camera '{name}'", times[name], rates[name])
        for name in rates
        if name in times
    }


def _of_camera(where: str, times: Mapping[int, float], fps: float | None) -> FrameTimes:
    if len(times) < 2:
        raise HandtrackError(f"{where}: times of {len(times)} frames; expected at least two.")
    frames = np.array(sorted(times))
    time_s = np.array([times[int(frame)] for frame in frames])
    steps = np.diff(time_s)
    if (steps <= 0).any():
        at = int(frames[1:][steps <= 0][0])
        raise HandtrackError(
            f"{where}: the time of frame {at} is not later than that of the frame before it."
        )
    step_s = float(np.median(steps / np.diff(frames)))
    _check_unit(where, step_s, fps)
    return FrameTimes(fps or 1 / step_s, frames.astype(float), time_s)


def _check_unit(where: str, step_s: float, fps: float | None) -> None:
    """Raise HandtrackError for times that are seconds only by their column's name."""
    if fps is None and step_s < _LONG_STEP_S:
        return
    for unit, size_s in _UNITS.items():
        step = step_s * size_s  # [s], if the times are of this unit
        meant = _USUAL_STEP_S[0] <= step < _USUAL_STEP_S[1] if fps is None else 0.5 < step * fps < 2
        if meant:
            agree = "" if fps is None else f", as fps = {fps:g} agrees with"
            raise HandtrackError(
                f"{where}: {step_s:.4g} s from frame to frame; expected seconds. Are these {unit}{agree}? Multiply time_s "
                f"by {size_s:g}. If they are seconds, confirm it with an fps of {1 / step_s:.3g} in session.toml."
            )


# ---- Cameras' frames joined to the session's by time


_HALF = 0.501  # of a frame's duration: half, and what rounding adds
_OFF_GRID = 0.05  # of a frame: half of what the doctor's estimate resolves
_LOOKED_AT = 500  # frames by which it is told how far joined frames lie apart


@array_dataclass
class CameraTimes:
    """A camera's frames against a session's, joined by time."""

    line: FrameTimes
    """of the session's frames"""
    own: FrameTimes
    """of the camera's, by the session's clock"""

    def own_frame(self, frame: int) -> int | None:
        """Return the camera's frame nearest to a session's frame; None where none lies within half a frame of it."""
        time_s = self.line.time_of(frame)
        own = self.own.nearest(time_s)
        off = abs(self.own.time_of(own) - time_s)
        return own if own >= 0 and off <= _HALF / self.line.fps else None

    def frames_later(self, frame: int) -> float:
        """Return how many of the session's frames later the camera's image was taken; 0 where it has none."""
        own = self.own_frame(frame)
        return (
            0.0
            if own is None
            else (self.own.time_of(own) - self.line.time_of(frame)) * self.line.fps
        )

    @property
    def note(self) -> str:
        """That the frames that are joined do not show the same moments, in a sentence; empty where they do."""
        joined = [f for f in range(_LOOKED_AT) if self.own_frame(f) is not None]
        off = float(np.mean([abs(self.frames_later(f)) for f in joined])) if joined else 0.0
        if off < _OFF_GRID:
            return ""
        return (
            f"its frames lie {off:.2g} of a frame ({1e3 * off / self.line.fps:.2g} ms) from the session's on average, by `lag_s`, "
            "`fps` or time stamps. The nearest whole frame is taken, and the hand is predicted "
            "at that frame's own time. A first pose leaves this out."
        )

    def frames(self, own: range) -> range:
        """Return the session's frames from 0 to the one that shows the last of the camera's."""
        return range(self.line.nearest(self.own.time_of(own.stop - 1)) + 1) if own else own


def session_times(
    folder: Path, recording: RecordingSettings, cameras: Sequence[CameraSettings]
) -> tuple[FrameTimes, dict[str, CameraTimes]]:
    """Return the times of a session's frames that session.toml and the file it names say, and how those of cameras whose frames are
    not simply numbered like them belong to them.

    The session's frames are those of the first camera with time stamps; without any, they come `fps` times a second. A
    camera without time stamps begins with the session. Raises HandtrackError.
    """
    stamps: dict[str, FrameTimes] = {}
    if recording.timestamps is not None:
        where = f"{folder / SESSION_FILE}, [session], timestamps"
        path = matching_files(folder, recording.timestamps, where)[0]
        stamps = read_timestamps(path, {c.name: c.fps or recording.fps for c in cameras})
    first = next((camera for camera in cameras if camera.name in stamps), None)
    if first is None:
        assert recording.fps is not None
        line = FrameTimes(recording.fps)
    else:
        line = stamps[first.name].later(-(first.lag_s or 0.0))
    joined: dict[str, CameraTimes] = {}
    for camera in cameras:
        own, lag_s = stamps.get(camera.name), camera.lag_s or 0.0
        if own is None and camera.fps is not None:
            own = FrameTimes(camera.fps).later(line.time_of(0))
        if camera is not first and (own is not None or lag_s):
            joined[camera.name] = CameraTimes(line, (own or line).later(-lag_s))
    return line, joined
