"""When each frame was taken: from the frame rate, or from a csv file of times."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import field
from pathlib import Path

import numpy as np

from handtrack.arrays import Floats, N, array_dataclass
from handtrack.errors import HandtrackError

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
    cameras = tuple(rates)
    times: dict[str, dict[int, float]] = {}
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            found = tuple(reader.fieldnames or ())
            if found != COLUMNS:
                raise HandtrackError(
                    f"{path}: the columns are {','.join(found) or 'missing'}; expected "
                    f"{','.join(COLUMNS)}."
                )
            for row in reader:
                where = f"{path}, line {reader.line_num}"
                camera, frame, time_s = _entry(row, where, cameras)
                if frame in times.setdefault(camera, {}):
                    raise HandtrackError(
                        f"{where}: a second time for camera '{camera}', frame {frame}."
                    )
                times[camera][frame] = time_s
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise HandtrackError(f"{path}: cannot be read as csv: {error}.") from None
    if not times:
        raise HandtrackError(f"{path}: times of 0 frames; expected at least two.")
    return {
        name: _of_camera(f"{path}, camera '{name}'", times[name], rates[name])
        for name in cameras
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


def _entry(row: dict[str, str], where: str, cameras: tuple[str, ...]) -> tuple[str, int, float]:
    try:
        if None in row:  # more columns than names: a decimal comma
            raise ValueError
        camera, frame, time_s = row["camera"], int(row["frame"]), float(row["time_s"])
    except (TypeError, ValueError):
        more = row.get(None) or ()  # type: ignore[call-overload]
        shown = ",".join([*(str(row[column]) for column in COLUMNS), *more])
        raise HandtrackError(
            f"{where}: '{shown}'; expected a camera, a whole frame number and seconds."
        ) from None
    if camera not in cameras:
        raise HandtrackError(f"{where}: unknown camera '{camera}'; known: {', '.join(cameras)}.")
    if frame < 0 or not math.isfinite(time_s):
        raise HandtrackError(
            f"{where}: frame {frame}, time {time_s}; expected a frame from 0 and finite seconds."
        )
    return camera, frame, time_s
