"""Timeline: the recording at a glance in lanes, with the frame slider over them; zoom, playback at the recording's pace."""

from __future__ import annotations

import html
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from handtrack.arrays import Array, Floats, Ints, N, runs
from handtrack_app import viser_internals as internals
from handtrack_app.page.html import chip
from handtrack_app.page.page import Page, Panel, UserState, put
from handtrack_app.page.panels.pose import status_of
from handtrack_app.palette import SEARCH_RESULT, STATUS, TERMS
from handtrack_app.protocol import (
    COST,
    ERROR,
    MOVED,
    PROBABILITY,
    TERM,
    VIEWS,
    PoseSnapshot,
    TimelineSnapshot,
)

_PLAY: tuple[str, ...] = ("⇤", "←", "▶", "→", "⇥")
_ZOOM: tuple[str, ...] = ("+", "−", "↔", "☰")
_SPEEDS = {"¼×": 0.25, "½×": 0.5, "1×": 1.0, "2×": 2.0}
_FACTOR = 2.0


@dataclass
class TimelinePanel(Panel):
    """Handles of the timeline. A click anywhere on the lanes goes there: the slider lies over them, and has their ends."""

    every: bool = False
    """all lanes, not only the first ones"""
    moved: Callable[[], None] = lambda: None
    """called when another part of the recording is shown"""
    _lanes: list[Lane] = field(default_factory=list)
    _pose: PoseSnapshot | None = None

    def build(self) -> None:
        page, gui = self.page, self.gui
        self.window, self._frame = Window.whole(self.frames), page.state.session.first_frame
        self.picture = gui.add_html("")
        self.cursor = gui.add_html("")
        self.slider = gui.add_slider("Frame", self.window.first, self.window.last, 1, self._frame)
        self.play = page.buttons(
            "Playback", _PLAY, self._pressed, "First frame, back, play or pause, next, last frame. Keys: Space, arrows.",
        )  # fmt: skip
        self.zoom = page.buttons(
            "Timeline", _ZOOM, self.look_closer, "Fewer frames, more frames, all frames; more lanes or the first ones.",
        )  # fmt: skip
        self.speed = page.choice("Speed", _SPEEDS, partial(setattr, page.state, "speed"), now="1×")
        page.on(self.slider, lambda _, frame: page.go_to(frame))
        page.key("Timeline: fewer frames", "shift+F", partial(self.look_closer, _ZOOM[0]))
        page.key("Timeline: more frames", "shift+G", partial(self.look_closer, _ZOOM[1]))

    def _pressed(self, key: str) -> None:
        page, state = self.page, self.state
        targets = (state.strip.start, state.frame - 1, None, state.frame + 1, state.strip.stop - 1)
        target = targets[_PLAY.index(key)]
        page.play(target is None and not state.playing)
        if target is not None:
            page.go_to(target)

    @property
    def frames(self) -> range:
        """Those of the recording."""
        return range(self.state.strip.start, self.state.strip.stop)

    def look_closer(self, how: str) -> None:
        """Show fewer frames or more, all, or other lanes: a button's sign, of `_ZOOM`."""
        if how == _ZOOM[3]:
            self.every = not self.every
            self._redraw()
        elif how == _ZOOM[2]:
            self.look_at(Window.whole(self.frames))
        else:
            factor = 1 / _FACTOR if how == _ZOOM[0] else _FACTOR
            self.look_at(self.window.zoomed(factor, self.state.frame))

    def look_at(self, window: Window) -> None:
        """Show a part of the recording."""
        if window != self.window:
            self.window = window
            self._redraw()
            self.moved()

    def show_frame(self, frame: int) -> None:
        """Move slider and cursor to a frame; where it is beyond the part that is shown, that goes along."""
        self._frame = frame
        self.look_at(self.window.around(frame))
        put(self.slider, max=max(self.slider.max, frame), value=frame)
        self._show_numbers()

    def show_pose(self, pose: PoseSnapshot) -> None:
        """Stand at a pose, and show its own numbers."""
        self._pose = pose
        self.show_frame(pose.frame)

    def show_timeline(self) -> None:
        """Take the recording's new status and energies."""
        if self.window.frames != self.frames:  # frames are counted, or come, while the page is open
            self.window = Window.whole(self.frames)
        self._redraw()

    def _redraw(self) -> None:
        """Send all lanes again."""
        strip = self.state.strip
        self._lanes = lanes_of(strip, self.window, self.every)
        put(self.picture, content=lanes_picture(self._lanes, strip, self.window, self.every))
        put(self.slider, min=self.window.first, max=self.window.last)
        self._show_numbers()

    def _show_numbers(self) -> None:
        """Show the numbers of the frame: those of the pose shown, where it is of that frame."""
        frame, pose = self._frame, self._pose
        pose = pose if pose is not None and pose.frame == frame else None
        row = self.frames.index(frame) if frame in self.frames else None
        put(self.cursor, content=cursor_picture(self._lanes, row, pose))


# ---- Lanes: the recording at a glance as one picture, which is sent once, and what is sent of it for a frame shown


# ---- The part of the recording that the lanes show: where frames stand in it, zooming and paging


WIDTH = 1000  # of the lanes, in their own units
_COLUMNS = 400  # of neighbouring frames: what is sent does not grow with the recording
_FEWEST = 10  # frames
_TICKS = 8  # at most, so that their numbers stand apart


@dataclass(frozen=True)
class Window:
    """Frames first to last of a recording's: they stand at 0 and at WIDTH, as on the slider that lies over them."""

    first: int
    last: int
    frames: range
    """all of the recording"""

    @classmethod
    def whole(cls, frames: range) -> Window:
        """Return the window of all frames."""
        return cls(frames.start, max(frames.stop - 1, frames.start + 1), frames)

    @property
    def count(self) -> int:
        return self.last - self.first + 1

    def place(self, frame: Any) -> Any:
        """Return where a frame stands, or each of several."""
        return (frame - self.first) / max(self.last - self.first, 1) * WIDTH

    def span(self, first: int, stop: int) -> tuple[float, float]:
        """Return where frames begin, half a frame before the first, and how wide they are: what is seen of them."""
        begin, end = np.clip(self.place(np.array([first, stop]) - 0.5), 0.0, WIDTH).tolist()
        return begin, end - begin

    def columns(self) -> Ints[N]:
        """Return where columns of neighbouring frames begin, the end with them: at most so many that each can be seen."""
        columns = min(self.count, _COLUMNS)
        return self.first + np.arange(columns + 1) * self.count // columns

    def ticks(self) -> list[int]:
        """Return round frame numbers to be named."""
        rough = max(self.count / _TICKS, 1.0)
        power = 10.0 ** np.floor(np.log10(rough))
        step = int(power * next(n for n in (1, 2, 5, 10) if n * power >= rough * 0.999))
        return list(range(-(-self.first // step) * step, self.last + 1, step))

    def zoomed(self, factor: float, around: int) -> Window:
        """Return a window of `factor` times as many frames, in which a frame stays where it stands."""
        most = len(self.frames)
        count = int(np.clip(round(self.count * factor), min(_FEWEST, most), most))
        share = (min(max(around, self.first), self.last) - self.first) / max(self.count - 1, 1)
        return self.moved_to(round(around - share * (count - 1)), count)

    def moved_to(self, first: int, count: int) -> Window:
        """Return a window of so many frames that begins at one, or where the recording lets it."""
        first = max(min(first, self.frames.stop - count), self.frames.start)
        return replace(self, first=first, last=min(first + count, self.frames.stop) - 1)

    def around(self, frame: int) -> Window:
        """Return a window with a frame in it: this, or the page that begins a tenth before it."""
        if self.first <= frame <= self.last:
            return self
        return self.moved_to(frame - self.count // 10, self.count)


def extremes(values: Array[N], window: Window) -> tuple[Floats[N], Floats[N], Floats[N]]:
    """Return of each column its place, and the least and largest known value in it, NaN where none is known. values: of the
    recording's frames, the last of which may be missing.
    """
    edges = window.columns()
    shown = np.full(window.count, np.nan)
    there = values[window.first - window.frames.start :][: window.count]
    shown[: len(there)] = np.where(np.isfinite(there), there, np.nan)
    at = edges[:-1] - window.first
    place = window.place((edges[:-1] + edges[1:] - 1) / 2)
    return place, np.fmin.reduceat(shown, at), np.fmax.reduceat(shown, at)


LEFT, RIGHT = 172, 90  # [px] where viser's slider begins and ends: it lies over the lanes
_CURVE, _STATUS, _LOW, _THIN, _TERM, _AXIS = 34, 14, 14, 14, 14, 18  # heights [px]
_REST, _LEAST = 2, 82  # [px]: the panel's edge; what the transport beside the lanes needs
_SEARCH_RESULT = 4  # beside Status: a search's pose, which no frame was tracked from
_SHOWN_AS = {**STATUS, _SEARCH_RESULT: SEARCH_RESULT}
_HEIGHTS = {-1: 3, 0: 7, _SEARCH_RESULT: 10, 3: 10, 1: 10, 2: 14}
"""[px] by status, from what is drawn least to what is drawn above all"""
_LOW_CONFIDENCE, _ACCEPTED, _GAP, _CHANGED = "#d55e00", "#009e73", "#e69f00", "#56b4e9"
_TAKES = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#f0e442", "#0072b2")
_FULL_MM = 20.0  # a change that is drawn in full colour: more than a finger is thick


@dataclass(frozen=True)
class Lane:
    """A strip of the picture."""

    label: str
    """HTML, beside it"""
    height: int
    """[px]"""
    parts: Sequence[str]
    """SVG, from 0 to WIDTH across and to `height` down"""
    value: Callable[[int], str]
    """what stands behind it for a frame, by its row, as it was tracked or set"""
    hint: str = ""
    of_pose: Callable[[PoseSnapshot], str] | None = None
    """what stands there for the pose shown, where that tells it; else `value` does, of a tracked one"""


def lanes_of(strip: TimelineSnapshot, window: Window, every: bool) -> list[Lane]:
    """Return the lanes that have something to show. every: not only the curve, the status and the probability of an error."""
    strip = _of_poses(strip)
    makers = (_curve_lane, _status_lane, _probability_lane)
    if every:
        makers += (_term_lane, _accepted_lane, _take_lane, _missing_lane, _moved_lane)
    return [lane for make in makers if (lane := make(strip, window)) is not None]


def _of_poses(strip: TimelineSnapshot) -> TimelineSnapshot:
    """Return it with the status of poses that were set, and without what is of the tracked ones beneath them."""
    rows = [f - strip.start for f in strip.by_hand if 0 <= f - strip.start < len(strip.status)]
    if not rows:
        return strip
    status, lanes = strip.status.copy(), {name: row.copy() for name, row in strip.lanes.items()}
    status[rows] = 3
    status[[f - strip.start for f in strip.searched if f - strip.start in rows]] = _SEARCH_RESULT
    for name in lanes.keys() - {ERROR}:
        lanes[name][rows] = np.nan
    return replace(strip, status=status, lanes=lanes)


def lanes_picture(
    lanes: Sequence[Lane], strip: TimelineSnapshot, window: Window, every: bool
) -> str:
    """Return the picture, with the legend above it and frame numbers below. every: whether these are all the lanes."""
    parts, labels, top = list[str](), "", 0
    for lane in lanes:
        parts.append(f"<g transform='translate(0 {top})'>{''.join(lane.parts)}</g>")
        title = f" title='{html.escape(lane.hint)}'" if lane.hint else ""
        labels += f"<div{title} class='handtrack-lane' style='top:{top}px;height:{lane.height}px'>{lane.label}</div>"
        top += lane.height
    top = _depth(lanes)
    return (
        f"<div class='handtrack-timeline{' handtrack-every' * every}' style='padding:0 {RIGHT}px 0 {LEFT}px;position:relative;font-size:12px'>"
        f"<style>:root{{--handtrack-lanes:{top + _AXIS}px;"
        f"--handtrack-below:calc({top + _AXIS + _REST}px * var(--mantine-scale))}}</style>"
        f"<div style='position:relative;height:{top + _AXIS}px'>{labels}"
        f"<div class='handtrack-lane' style='left:30%;top:2px'>{_legends(strip)}</div>"
        f"<svg viewBox='0 0 {WIDTH} {top + _AXIS}' preserveAspectRatio='none' "
        f"style='width:100%;height:100%;display:block'>{_grid(window, top)}{''.join(parts)}</svg>{_numbers(window, top)}</div></div>"
    )


def _depth(lanes: Sequence[Lane]) -> int:
    """Return where the frame numbers begin [px]: below all lanes, and the transport beside them has its room."""
    return max(sum(lane.height for lane in lanes), _LEAST - _REST - _AXIS)


def cursor_picture(lanes: Sequence[Lane], row: int | None, pose: PoseSnapshot | None) -> str:
    """Return the numbers beside the lanes for the frame shown. It is sent for each frame; the line itself is the slider's.

    row: of the frame; None: the recording has no such frame. pose: the one shown, if it is of that frame.
    """
    rows, top = "", 0
    for lane in lanes:
        value = ""
        if pose is not None and lane.of_pose is not None:
            value = lane.of_pose(pose)
        elif row is not None and (pose is None or pose.origin == "tracked"):
            value = lane.value(row)
        line = _TERM if "<" in value else lane.height
        if value:
            rows += f"<div style='position:absolute;top:{top}px;line-height:{line}px'>{value}</div>"
        top += lane.height
    return (
        "<div style='position:relative;height:0;pointer-events:none'>"
        f"<div style='position:absolute;right:4px;bottom:0;height:{_depth(lanes) + _AXIS}px;width:{RIGHT - 10}px;font-size:11px;"
        f"white-space:nowrap'>{rows}</div></div>"
    )


# ---- lanes


def _curve_lane(strip: TimelineSnapshot, window: Window) -> Lane:
    none = np.full(len(strip.status), np.nan)
    title, unit, values = "joint error", " mm", strip.lanes.get(ERROR, none)
    if not np.isfinite(values).any():
        title, unit, values = "cost", "", strip.lanes.get(COST, none)
    finite = values[np.isfinite(values)]
    top = f"max {_number(finite.max())}{unit}" if len(finite) else "nothing tracked"
    diamonds = [
        _diamond(window.place(f), f in strip.searched)
        for f in strip.by_hand
        if window.first <= f <= window.last
    ]

    def formatted(value: float) -> str:
        return f"{_number(value)}{unit}" if math.isfinite(value) else ""

    return Lane(
        f"<span>{title}</span><span style='opacity:.7'>{top}</span>", _CURVE,
        [_ground(_CURVE), *curve(values, window, _CURVE), *diamonds], _value_of(values, formatted),
        "Where frames share a pixel, the largest value is shown. Diamonds are keyframes.",
        lambda pose: formatted(pose.error_mm if unit else pose.energy),
    )  # fmt: skip


def _status_lane(strip: TimelineSnapshot, window: Window) -> Lane:
    def of_pose(pose: PoseSnapshot) -> str:
        return _SHOWN_AS[-1][0] if pose.origin == "carried" else status_of(pose)[0]

    def value(row: int) -> str:
        return _SHOWN_AS[int(strip.status[row])][0]

    return Lane("", _STATUS, bars(strip.status, window), value, of_pose=of_pose)


def _probability_lane(strip: TimelineSnapshot, window: Window) -> Lane | None:
    values = strip.lanes.get(PROBABILITY)
    if values is None:
        return None
    place, _, high = extremes(values, window)
    parts = [_ground(_LOW)]
    for a, b in runs(np.isfinite(high)):
        points = _points(place[a:b], _LOW - 1 - (_LOW - 3) * high[a:b])
        around = f"{place[a]:.1f},{_LOW} {points} {place[b - 1]:.1f},{_LOW}"
        parts.append(f"<polygon points='{around}' fill='{_LOW_CONFIDENCE}' opacity='.75'/>")
    return Lane(
        "P(error &gt; 25 mm)", _LOW, parts, _value_of(values, lambda v: f"{100 * v:.0f} %"),
        "Probability that some joint's error exceeds 25 mm.",
    )  # fmt: skip


def _term_lane(strip: TimelineSnapshot, window: Window) -> Lane | None:
    """Return the energy's parts, where more than silhouettes were looked at."""
    terms = term_rows(strip)
    if not terms:
        return None
    top = max(float(np.nanquantile(row, 0.98)) for row in terms.values()) * 1.1
    height = max(_TERM * len(terms), 40)
    parts, label = [_ground(height)], ""
    for word, row in terms.items():
        colour = TERMS.get(word, "#ffffff")
        parts += curve(row, window, height, max(top, 1e-12), colour)
        label += f"<span style='height:{_TERM}px;white-space:nowrap'>{chip(colour)}{word}</span>"
    values = [_value_of(row, _number) for row in terms.values()]

    def value(row: int) -> str:
        return "".join(f"<div>{one(row) or '&nbsp;'}</div>" for one in values)

    return Lane(label, height, parts, value, f"The cost's terms, to {_number(top)}")


def term_rows(strip: TimelineSnapshot) -> dict[str, Floats[N]]:
    """Return the energy's parts by their words, in order; none where only silhouettes were looked at."""
    tracked = int((strip.status >= 0).sum())
    parts = {n.removeprefix(TERM): v for n, v in strip.lanes.items() if n.startswith(TERM)}
    terms = {n: v for n, v in parts.items() if np.isfinite(v).sum() > min(tracked - 1, 1)}
    observed = terms.keys() - {"priors"}
    if len(observed) < 2 and not observed & {"cloud→model", "lines of sight"}:
        return {}
    return {name: terms[name] for name in dict.fromkeys((*TERMS, *terms)) if name in terms}


def _accepted_lane(strip: TimelineSnapshot, window: Window) -> Lane | None:
    if not strip.accepted:
        return None
    marked = np.isin(window.frames, [*strip.accepted])
    return Lane(
        "accepted", _THIN, _blocks(marked, window, _ACCEPTED), lambda row: "locked" if marked[row] else "",
        "Frames that neither tracking nor refining changes.", lambda pose: "locked" if pose.accepted else "",
    )  # fmt: skip


def _take_lane(strip: TimelineSnapshot, window: Window) -> Lane | None:
    if len(strip.takes) < 2:
        return None
    order = sorted({span.take for span in strip.takes})
    parts = []
    for span in strip.takes:
        x, width = window.span(span.first, span.stop)
        if width > 0:
            colour = _TAKES[order.index(span.take) % len(_TAKES)]
            parts.append(_block(x, width, f"fill='{colour}'"))

    def at(frame: int) -> str:
        return next((f"take {s.take}" for s in strip.takes if s.first <= frame < s.stop), "")

    return Lane(
        "takes", _THIN, parts, lambda row: at(strip.start + row), "The take that each frame comes from.",
        lambda pose: at(pose.frame),
    )  # fmt: skip


def _missing_lane(strip: TimelineSnapshot, window: Window) -> Lane | None:
    views = strip.lanes.get(VIEWS)
    missing = None if views is None else np.nanmax(views) - views
    hint = "Number of views in which nothing was observed."
    return _thin(window, "views missing", missing, 1.0, _GAP, "{:.0f}", hint)


def _moved_lane(strip: TimelineSnapshot, window: Window) -> Lane | None:
    hint = "Largest displacement of a joint from the take below, by refining or tracking again."
    return _thin(window, "changed", strip.lanes.get(MOVED), _FULL_MM, _CHANGED, "{:.1f} mm", hint)


def _thin(
    window: Window, label: str, values: Floats[N] | None, full: float, colour: str, form: str, hint: str
) -> Lane | None:  # fmt: skip
    if values is None or not (values > 0).any():
        return None
    parts = _blocks(values / full, window, colour)
    return Lane(label, _THIN, parts, _value_of(values, form.format), hint)


# ---- parts of lanes


def curve(
    values: Floats[N], window: Window, height: float, top: float | None = None, colour: str = "#56b4e9"
) -> list[str]:  # fmt: skip
    """Return lines through the known values, up to `top`, or to what nearly all are below. Of frames that are drawn in one place, the
    largest counts.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        return []
    if top is None:
        top = max(float(np.quantile(finite, 0.98)) * 1.1, 1e-12)
    place, _, highest = extremes(values, window)
    down = height - np.clip(highest / top, 0, 1) * (height - 3)
    lines = []
    for a, b in runs(np.isfinite(highest)):
        points = _points(place[a:b], down[a:b])
        points += f" {points}" * (b - a == 1)  # seen, too
        lines.append(
            f"<polyline points='{points}' fill='none' stroke='{colour}' stroke-width='1.6' stroke-linecap='round' "
            "vector-effect='non-scaling-stroke'/>"
        )
    return lines


def _points(x: Floats[N], y: Floats[N]) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))


def bars(status: Ints[N], window: Window) -> list[str]:
    """Runs of equal status. Height tells them apart as well as colour: the worse, the taller. Of frames that are drawn in
    one place, the worst counts.
    """
    badness = np.array([*_HEIGHTS])
    _, _, high = extremes(np.argsort(badness)[status + 1], window)  # status −1 comes first
    results = []
    for code, x, width in _pieces(badness[np.nan_to_num(high).astype(int)], window):
        height = _HEIGHTS[code]
        fill = "fill='currentColor' opacity='.25'" if code == -1 else f"fill='{_SHOWN_AS[code][1]}'"
        results.append(_block(x, width, fill, _STATUS - height, height))
    return results


def _blocks(shares: Array[N], window: Window, colour: str) -> list[str]:
    """Return blocks where shares are above 0, in four strengths of the colour: the full one from 1 on."""
    _, _, high = extremes(shares, window)
    strength = np.ceil(4 * np.clip(np.nan_to_num(high), 0.0, 1.0)).astype(int)
    return [
        _block(x, width, f"fill='{colour}' opacity='{0.25 * code:.2f}'")
        for code, x, width in _pieces(strength, window)
        if code
    ]


def _block(x: float, width: float, fill: str, y: int = 3, height: int = 8) -> str:
    return f"<rect x='{x:.1f}' y='{y}' width='{width:.1f}' height='{height}' {fill}/>"


def _pieces(codes: Ints[N], window: Window) -> list[tuple[int, float, float]]:
    """Return runs of equal codes of the window's columns: code, place and width."""
    places = window.columns().tolist()
    edges = [0, *np.flatnonzero(np.diff(codes)) + 1, len(codes)]
    return [(int(codes[a]), *window.span(places[a], places[b])) for a, b in pairwise(edges)]


def _grid(window: Window, height: int) -> str:
    return "".join(
        f"<path d='M{window.place(f):.1f} 0V{height + 4}' stroke='currentColor' opacity='.12' vector-effect='non-scaling-stroke'/>"
        for f in window.ticks()
    )


def _numbers(window: Window, top: int) -> str:
    return "".join(
        f"<div style='position:absolute;left:{window.place(f) / WIDTH * 100:.2f}%;top:{top + 2}px;line-height:{_AXIS - 2}px;transform:translateX(-50%);"
        f"opacity:.85;font-size:11px'>{f}</div>"
        for f in window.ticks()
    )


def _ground(height: int) -> str:
    return f"<rect width='{WIDTH}' height='{height - 2}' fill='currentColor' opacity='.05'/>"


def _diamond(x: float, is_searched: bool) -> str:
    y, colour = _CURVE - 10, (SEARCH_RESULT if is_searched else STATUS[3])[1]
    return f"<path d='M{x:.1f} {y - 7} l5 7 l-5 7 l-5 -7 z' fill='{colour}'/>"


def _legends(strip: TimelineSnapshot) -> str:
    shown = {code for code in STATUS if code >= 0 and (strip.status == code).any()}
    shown |= {3} if len(strip.by_hand) > len(strip.searched) else set()
    marks = [STATUS[code] for code in sorted(shown)] + [SEARCH_RESULT] * bool(strip.searched)
    return "".join(
        f"<span style='margin-left:.9em'>{chip(colour)}{word}</span>" for word, colour in marks
    )


def _value_of(values: Floats[N], form: Callable[[float], str]) -> Callable[[int], str]:
    return lambda row: form(values[row]) if math.isfinite(values[row]) else ""


def _number(value: float) -> str:
    return f"{value:.1f}" if abs(value) < 100 else f"{value:.0f}"


# ---- Playback at the recording's pace


_MOST = 2
"""frames under way: one is made while one is drawn"""
_QUESTION = "handtrack.drawn"
_TIMES = 2
"""the page answers as it takes what it is told; when it answers again, it has drawn that, and loaded the pictures"""


@dataclass(frozen=True)
class Drawn:
    """A page has drawn the frame that it was told last."""


class InFlight:
    """Frames that are played and that no page has drawn yet: a slow page gets fewer, each of them whole.

    A page tells by answering a question that comes behind all that is of the frame: what its browser keeps under a name. The one that
    answers first counts: another may lie in a hidden tab, where it draws nothing.
    """

    def __init__(self, page: Page, drawn: Callable[[Drawn], None]) -> None:
        """drawn: is told when the page has drawn a frame."""
        self._page, self._report = page, drawn
        self._frames = deque[int]()
        self._drawing: int | None = None
        self._question, self._times = "", 0
        """asked last, and how often for the frame; empty once it is answered"""
        self._count = 0
        self._lock = threading.Lock()
        internals.on_storage(page.server, self._answered)

    @property
    def has_room(self) -> bool:
        """Whether another frame may be asked for."""
        return len(self._frames) < _MOST

    @property
    def is_watched(self) -> bool:
        """Whether a page is there to see what is played."""
        return bool(self._page.clients)

    @property
    def is_drawing(self) -> bool:
        """Whether a frame was told and is not drawn yet: the next one waits for that."""
        return self._drawing is not None

    def begin(self, frame: int) -> None:
        """A frame is asked for."""
        with self._lock:
            self._frames.append(frame)

    def clear(self) -> None:
        """Wait for none of them any more."""
        with self._lock:
            self._frames.clear()
            self._drawing = None

    def show(self, frame: int) -> None:
        """All that is of a frame was told: ask the pages, behind it. Where there is none, nobody is waited for."""
        if not self.is_watched:
            self._drawn(frame)
            return
        with self._lock:
            self._drawing = frame
        self._ask(1)

    def _ask(self, times: int) -> None:
        with self._lock:
            self._count += 1
            question = f"drawn {self._count % 8}"  # viser keeps one of each for those who come
            self._question, self._times = question, times
        asked = internals.messages.LocalStorageGetItemRequestMessage(_QUESTION, question)
        internals.send(self._page.server, asked)

    def _answered(self, question: str) -> None:
        with self._lock:
            frame, times = self._drawing, self._times
            if question != self._question or frame is None:
                return
            self._question = ""
        if times < _TIMES:
            self._ask(times + 1)
        else:
            self._drawn(frame)

    def _drawn(self, frame: int) -> None:
        with self._lock:
            self._drawing = None
            while frame in self._frames:  # those before it gave way to it
                if self._frames.popleft() == frame:
                    break
        self._report(Drawn())


class Player:
    """A clock on its own thread. It asks for frames; frames that come too late are skipped."""

    def __init__(
        self,
        state: UserState,
        ask: Callable[[int], None],
        in_flight: InFlight,
        ended: Callable[[], None],
    ) -> None:
        """ask: for a frame with all that is of it. ended: called when playback ends, or an edit has ended it."""
        self.fps = 25.0
        self._state, self._ask, self._in_flight, self._ended = state, ask, in_flight, ended
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._work, name="player", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stopping.set()
        self._thread.join(2.0)

    def _work(self) -> None:
        state = self._state
        while not self._stopping.wait(0.03):
            if not (state.playing and self._in_flight.is_watched):
                continue  # a page left open, and closed, is no work for anybody
            began, first = time.monotonic(), state.frame
            if first >= state.strip.stop - 1:
                first = state.strip.start
            last_asked = -1
            self._in_flight.clear()
            pace = self.fps * state.speed
            while (
                state.playing
                and self._in_flight.is_watched
                and pace == self.fps * state.speed
                and not self._stopping.is_set()
            ):
                due = first + int((time.monotonic() - began) * pace)
                if due > state.strip.stop - 1:
                    first = due = state.strip.start
                    began = time.monotonic()
                if due != last_asked and self._in_flight.has_room:
                    last_asked = due
                    with state.lock:  # an edit that begins now comes first, and ends it
                        if state.playing:
                            self._ask(due)
                time.sleep(0.4 / max(pace, 1.0))
            if not state.playing:
                self._ended()
