"""The course of a joint parameter as a drawing: the track, its uncertainty as a band, another take, the truth; or their speed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import F, Floats, N
from handtrack_app.page.time.angles import anatomical, angle_parts, unit_of
from handtrack_app.page.time.drawing import INK, Area, Drawing, Line, Part, Point, Words
from handtrack_app.page.time.window import Window, extremes, runs
from handtrack_app.protocol.comparing import Curve, CurvesSnapshot

_OWN, _OTHER, _TRUTH = "#3594d6", "#e69f00", "#009e73"
_LEFT, _RIGHT, _TOP, _BOTTOM = 40.0, 8.0, 20.0, 16.0
_BAND = 2.0
"""standard deviations on either side: 19 of 20 errors, were they normal"""
_LEAST = {"°": 10.0, "mm": 10.0}  # that the scale spans at least: noise is not to fill it


@dataclass(frozen=True)
class Motion:
    """What is said of a curve in a window, in its unit."""

    least: float
    most: float
    fastest: float
    """a second"""
    typical: float
    """median speed, a second"""


def motion_of(values: Floats[N], fps: float) -> Motion | None:
    """Return range of motion and speed; None where fewer than two frames follow one another."""
    speed = np.abs(np.diff(values)) * fps
    known = values[np.isfinite(values)]
    speed = speed[np.isfinite(speed)]
    if not len(speed):
        return None
    return Motion(
        float(known.min()), float(known.max()), float(speed.max()), float(np.median(speed))
    )


def speed_of(values: Floats[F], fps: float) -> Floats[F]:
    """Return the speed at each frame, a second: the mean of the steps to it and from it."""
    steps = np.diff(values) * fps
    before, after = np.r_[np.nan, steps], np.r_[steps, np.nan]
    both = np.stack([before, after])
    known = np.isfinite(both)
    total = np.where(known, both, 0.0).sum(axis=0)
    count = known.sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def plots(
    snapshot: CurvesSnapshot, window: Window, speed: bool, width: float, height: float
) -> Drawing:
    """Return all curves below one another, in a window of frames. height: of each; speed: instead of angles and places."""
    parts: list[Part] = []
    for n, curve in enumerate(snapshot.curves):
        parts += _one(snapshot, curve, window, speed, (0.0, n * height, width, height))
    legend = [("the track", _OWN)]
    if snapshot.take is not None:
        legend.append((f"take {snapshot.take}", _OTHER))
    if any(len(curve.truth) for curve in snapshot.curves):
        legend.append(("truth", _TRUTH))
    top, x = len(snapshot.curves) * height + 14, _LEFT
    for words, colour in legend:
        parts += [Line([(x, top - 3), (x + 14, top - 3)], colour, 2.5), Words(x + 18, top, words, 10)]  # fmt: skip
        x += 24 + 5.6 * len(words)
    if not speed:
        parts += [Area([(x, top - 8), (x + 14, top - 8), (x + 14, top + 2), (x, top + 2)], _OWN, 0.25), Words(x + 18, top, f"± {_BAND:.0f} σ", 10)]  # fmt: skip
    return Drawing(width, top + 8, parts)


def _one(
    snapshot: CurvesSnapshot,
    curve: Curve,
    window: Window,
    speed: bool,
    box: tuple[float, float, float, float],
) -> list[Part]:
    """Return one curve with its axes, name and picture, within x, y, width, height."""
    left, top, width, height = box
    scale, unit = unit_of(curve.name)
    per_s, columns = f"{unit}/s" if speed else unit, round(width / 2)
    series = [(curve.truth, _TRUTH), (curve.other, _OTHER), (curve.values, _OWN)]
    shown = [(values / scale, colour) for values, colour in series if np.isfinite(values).any()]
    motion = motion_of(_within(curve.values / scale, snapshot.start, window), snapshot.fps)
    if speed:
        shown = [(speed_of(values, snapshot.fps), colour) for values, colour in shown]
    icon = min(height - _TOP - _BOTTOM, 56.0)
    x0, x1 = left + _LEFT, left + width - _RIGHT - icon - 4
    y0, y1 = top + _TOP, top + height - _BOTTOM
    low, high = _span([_within(values, snapshot.start, window) for values, _ in shown], unit)

    def at(place: float, value: float) -> Point:
        inside = min(max(value, low), high)
        return x0 + place / 1000 * (x1 - x0), y1 - (inside - low) / (high - low) * (y1 - y0)

    parts: list[Part] = [Words(left + 4, top + 13, f"{anatomical(curve.name)} [{per_s}]", 11 if width > 500 else 10, bold=True)]  # fmt: skip
    for value in _steps(low, high):
        parts.append(Line([at(0, value), at(1000, value)], "#8c8c8c", 0.4))
        parts.append(Words(x0 - 4, at(0, value)[1] + 3, f"{value:g}", 9, "end"))
    for frame in window.ticks()[:: 1 if width > 500 else 2]:
        parts.append(Words(at(window.place(frame), low)[0], y1 + 12, str(frame), 9, "middle"))
    if not speed:
        parts += _band(curve, scale, snapshot.start, window, at, columns)
    for values, colour in shown:
        parts += _lines(values, snapshot.start, window, at, colour, columns)
    parts += angle_parts(curve.name, x1 + 8, y0 - 4, icon)
    if motion is not None:
        words = (
            f"fastest {motion.fastest:.0f} {unit}/s, half below {motion.typical:.0f}"
            if speed
            else f"{round(motion.least)} to {round(motion.most)} {unit}"
        )
        parts.append(Words(left + width - 6, top + (13 if width > 500 else 24), words, 9, "end"))
    parts.append(Line([(x0, y0), (x0, y1), (x1, y1)], INK, 0.8))
    return parts


def _within(values: Floats[N], start: int, window: Window) -> Floats[N]:
    return values[max(window.first - start, 0) : max(window.last + 1 - start, 0)]


def _span(series: Sequence[Floats[N]], unit: str) -> tuple[float, float]:
    """Return the scale's ends: round, around all that is known."""
    known = np.concatenate([values[np.isfinite(values)] for values in series] or [np.zeros(0)])
    if not len(known):
        return 0.0, _LEAST[unit]
    low, high = float(known.min()), float(known.max())
    spare = max(0.06 * (high - low), 0.5 * (_LEAST[unit] - (high - low)), 0.0)
    return low - spare, high + spare


def _steps(low: float, high: float) -> list[float]:
    """Return three or four round values between two."""
    rough = (high - low) / 3.5
    power = 10.0 ** math.floor(math.log10(rough))
    step = power * next(n for n in (1, 2, 2.5, 5, 10) if n * power >= rough * 0.999)
    first = math.ceil(low / step)
    return [round(n * step, 10) for n in range(first, math.floor(high / step) + 1)]


def _band(
    curve: Curve,
    scale: float,
    start: int,
    window: Window,
    at: Callable[[float, float], Point],
    columns: int,
) -> list[Part]:
    low, high = curve.values - _BAND * curve.std, curve.values + _BAND * curve.std
    place, least, _ = extremes(
        np.where(np.isfinite(low), low, np.nan) / scale, start, window, columns
    )
    _, _, most = extremes(np.where(np.isfinite(high), high, np.nan) / scale, start, window, columns)
    found: list[Part] = []
    for a, b in runs(np.isfinite(least) & np.isfinite(most)):
        above = [at(x, y) for x, y in zip(place[a:b], most[a:b], strict=True)]
        below = [at(x, y) for x, y in zip(place[a:b], least[a:b], strict=True)]
        found.append(Area([*above, *below[::-1]], _OWN, 0.25))
    return found


def _lines(
    values: Floats[F],
    start: int,
    window: Window,
    at: Callable[[float, float], Point],
    colour: str,
    columns: int,
) -> list[Part]:
    """Return lines through known values; of frames that stand in one place, through the least and the largest."""
    place, low, high = extremes(values, start, window, columns)
    found: list[Part] = []
    for a, b in runs(np.isfinite(high)):
        points = [
            at(x, y)
            for x, least, most in zip(place[a:b], low[a:b], high[a:b], strict=True)
            for y in ((least,) if least == most else (least, most))
        ]
        found.append(Line(points if len(points) > 1 else points * 2, colour, 1.5))
    return found
