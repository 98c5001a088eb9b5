"""When each frame was taken: from the frame rate, or from a csv file of times."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from pathlib import Path

import numpy as np

from handtrack.arrays import Floats, N, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.files.text_files import read_rows, read_text

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
