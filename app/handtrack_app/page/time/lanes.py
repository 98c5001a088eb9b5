"""Lanes: the recording at a glance as one picture, which is sent once, and what is sent of it for a frame shown."""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from handtrack.arrays import Floats, Ints, N, runs
from handtrack_app.page.html import chip
from handtrack_app.page.panels.pose import status_of
from handtrack_app.protocol.palette import FOUND, STATUS, TERMS
from handtrack_app.protocol.snapshots import (
    COST,
    ERROR,
    MOVED,
    PROBABILITY,
    TERM,
    VIEWS,
    PoseSnapshot,
    TimelineSnapshot,
)

# ---- The part of the recording that the lanes show: where frames stand in it, zooming and paging


WIDTH = 1000  # of the lanes, in their own units
_COLUMNS = 400  # of neighbouring frames: what is sent does not grow with the recording
_FEWEST = 10  # frames
_TICKS = 8  # at most, so that their numbers stand apart


@dataclass(frozen=True)
class Window:
    """Frames first to last: they stand at 0 and at WIDTH, as on the slider that lies over them."""

    first: int
    last: int

    @property
    def count(self) -> int:
        return self.last - self.first + 1

    def place(self, frame: float) -> float:
        """Return where a frame stands."""
        return (frame - self.first) / max(self.last - self.first, 1) * WIDTH

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

    def zoomed(self, factor: float, around: int, frames: range) -> Window:
        """Return a window of `factor` times as many frames, in which a frame stays where it stands."""
        count = int(np.clip(round(self.count * factor), min(_FEWEST, len(frames)), len(frames)))
        share = (min(max(around, self.first), self.last) - self.first) / max(self.count - 1, 1)
        return Window(0, count - 1).moved_to(round(around - share * (count - 1)), frames)

    def moved_to(self, first: int, frames: range) -> Window:
        """Return a window as long as this that begins at a frame, or where the recording lets it."""
        first = max(min(first, frames.stop - self.count), frames.start)
        return Window(first, min(first + self.count, frames.stop) - 1)

    def around(self, frame: int, frames: range) -> Window:
        """Return a window with a frame in it: this, or the page that begins a tenth before it."""
        if self.first <= frame <= self.last:
            return self
        return self.moved_to(frame - self.count // 10, frames)

    @property
    def half(self) -> float:
        """Half a frame's width."""
        return 0.5 * WIDTH / max(self.last - self.first, 1)


def whole(frames: range) -> Window:
    """Return the window of all frames."""
    return Window(frames.start, max(frames.stop - 1, frames.start + 1))


def extremes(
    values: Floats[N], start: int, window: Window
) -> tuple[Floats[N], Floats[N], Floats[N]]:
    """Return of each column its place, and the least and largest known value in it, NaN where none is known. start: of values."""
    edges = window.columns()
    padded = np.full(window.count, np.nan)
    first, stop = max(window.first, start), min(window.last + 1, start + len(values))
    if first < stop:
        padded[first - window.first : stop - window.first] = values[first - start : stop - start]
    known, at = np.isfinite(padded), edges[:-1] - window.first
    low = np.minimum.reduceat(np.where(known, padded, np.inf), at)
    high = np.maximum.reduceat(np.where(known, padded, -np.inf), at)
    place = np.array([window.place(x) for x in (edges[:-1] + edges[1:] - 1) / 2])
    none = ~np.isfinite(high)
    return place, np.where(none, np.nan, low), np.where(none, np.nan, high)


LEFT, RIGHT = 172, 90  # [px] where viser's slider begins and ends: it lies over the lanes
_CURVE, _STATUS, _LOW, _THIN, _TERM, _AXIS = 34, 14, 14, 14, 14, 18  # heights [px]
_REST, _LEAST = 2, 82  # [px]: the panel's edge; what the transport beside the lanes needs
_FOUND = 5  # beside the codes of contracts §5: a search's pose, which no frame was tracked from
_SHOWN_AS = {**STATUS, _FOUND: FOUND}
_BADNESS = (
    -1,
    0,
    4,
    _FOUND,
    3,
    1,
    2,
)  # status, from what is drawn least to what is drawn above all
_HEIGHTS = {-1: 3, 0: 7, 4: 7, _FOUND: 10, 3: 10, 1: 10, 2: 14}
_DOUBT, _ACCEPTED, _GAP, _CHANGED = "#d55e00", "#009e73", "#e69f00", "#56b4e9"
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
    """what stands behind it for a frame, as it was tracked or set"""
    hint: str = ""
    of_pose: Callable[[PoseSnapshot], str] | None = None
    """what stands there for the pose shown, where that tells it; else `value` does, of a tracked one"""


def lanes_of(strip: TimelineSnapshot, window: Window, every: bool = True) -> list[Lane]:
    """Return the lanes that have something to show. every: not only the curve, the status and the probability of an error."""
    strip = _of_poses(strip)
    curve, title, unit = _main_curve(strip)
    found = [_curve_lane(strip, window, curve, title, unit), _status_lane(strip, window)]
    if not every:
        return [*found, *([low] if (low := _probability_lane(strip, window)) is not None else [])]
    more = [
        _probability_lane(strip, window), _term_lane(strip, window), _accepted_lane(strip, window),
        _take_lane(strip, window), *_thin_lanes(strip, window),
    ]  # fmt: skip
    return found + [lane for lane in more if lane is not None]


def _of_poses(strip: TimelineSnapshot) -> TimelineSnapshot:
    """Return it with the status of poses that were set, and without what is of the tracked ones beneath them."""
    rows = [f - strip.start for f in strip.by_hand if 0 <= f - strip.start < len(strip.status)]
    if not rows:
        return strip
    status, lanes = strip.status.copy(), {name: row.copy() for name, row in strip.lanes.items()}
    status[rows] = 3
    status[[f - strip.start for f in strip.found if f - strip.start in rows]] = _FOUND
    for name in lanes.keys() - {ERROR}:
        lanes[name][rows] = np.nan
    return replace(strip, status=status, lanes=lanes)


def lanes_picture(
    lanes: Sequence[Lane], strip: TimelineSnapshot, window: Window, every: bool = False
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


def cursor_picture(lanes: Sequence[Lane], frame: int, pose: PoseSnapshot | None = None) -> str:
    """Return the numbers beside the lanes for the frame shown. It is sent for each frame; the line itself is the slider's.

    pose: the one shown, if it is of that frame.
    """
    rows, top = "", 0
    for lane in lanes:
        if pose is None:
            value = lane.value(frame)
        elif lane.of_pose is not None:
            value = lane.of_pose(pose)
        else:
            value = lane.value(frame) if pose.origin == "tracked" else ""
        rows += (
            f"<div style='position:absolute;top:{top}px;height:{lane.height}px;line-height:{lane.height}px'>{value}</div>"
            if value and "<" not in value
            else f"<div style='position:absolute;top:{top}px;line-height:{_TERM}px'>{value}</div>"
            if value
            else ""
        )
        top += lane.height
    return (
        "<div style='position:relative;height:0;pointer-events:none'>"
        f"<div style='position:absolute;right:4px;bottom:0;height:{_depth(lanes) + _AXIS}px;width:{RIGHT - 10}px;font-size:11px;"
        f"white-space:nowrap'>{rows}</div></div>"
    )


# ---- lanes


def _main_curve(strip: TimelineSnapshot) -> tuple[Floats[N], str, str]:
    """Return the values of the first lane, what they are, and their unit."""
    none = np.full(len(strip.status), np.nan)
    errors = strip.lanes.get(ERROR, none)
    if np.isfinite(errors).any():
        return errors, "joint error", "mm"
    return strip.lanes.get(COST, none), "cost", ""


def _curve_lane(
    strip: TimelineSnapshot, window: Window, values: Floats[N], title: str, unit: str
) -> Lane:
    finite = values[np.isfinite(values)]
    top = f"max {_number(float(finite.max()))} {unit}" if len(finite) else "nothing tracked"
    diamonds = [
        _diamond(window.place(f), f in strip.found)
        for f in strip.by_hand
        if window.first <= f <= window.last
    ]

    def of_pose(pose: PoseSnapshot) -> str:
        value = pose.error_mm if unit else pose.energy
        return f"{_number(value)} {unit}" if math.isfinite(value) else ""

    return Lane(
        f"<span>{title}</span><span style='opacity:.7'>{top}</span>", _CURVE,
        [_ground(_CURVE), *curve(values, strip.start, window, _CURVE), *diamonds],
        _value_of(strip, values, lambda v: f"{_number(v)} {unit}"),
        "Of frames that stand in one place the largest counts. Diamonds are poses that were set.", of_pose,
    )  # fmt: skip


def _status_lane(strip: TimelineSnapshot, window: Window) -> Lane:
    words = {code: word for code, (word, _) in _SHOWN_AS.items()}

    def value(frame: int) -> str:
        row = frame - strip.start
        return words[int(strip.status[row])] if 0 <= row < len(strip.status) else ""

    def of_pose(pose: PoseSnapshot) -> str:
        return words[-1] if pose.origin == "carried" else status_of(pose)[0]

    return Lane("", _STATUS, bars(strip.status, strip.start, window), value, of_pose=of_pose)


def _probability_lane(strip: TimelineSnapshot, window: Window) -> Lane | None:
    values = strip.lanes.get(PROBABILITY)
    if values is None:
        return None
    place, _, high = extremes(values, strip.start, window)
    parts = [_ground(_LOW)]
    for a, b in runs(np.isfinite(high)):
        points = [f"{x:.1f},{_LOW - 1 - (_LOW - 3) * y:.1f}" for x, y in zip(place[a:b], high[a:b], strict=True)]  # fmt: skip
        around = f"{place[a]:.1f},{_LOW} {' '.join(points)} {place[b - 1]:.1f},{_LOW}"
        parts.append(f"<polygon points='{around}' fill='{_DOUBT}' opacity='.75'/>")
    return Lane(
        "P(error &gt; 25 mm)", _LOW, parts, _value_of(strip, values, lambda v: f"{100 * v:.0f} %"),
        "Probability that some joint is more than 25 mm off.",
    )  # fmt: skip


def _term_lane(strip: TimelineSnapshot, window: Window) -> Lane | None:
    """Return the energy's parts, where more than silhouettes were looked at."""
    terms = term_rows(strip)
    if not terms:
        return None
    top = max(float(np.nanquantile(row, 0.98)) for row in terms.values()) * 1.1
    height = max(_TERM * len(terms), 40)
    colours = {word: TERMS.get(word, "#ffffff") for word in terms}
    lines = [
        part
        for word, row in terms.items()
        for part in curve(row, strip.start, window, height, max(top, 1e-12), colours[word])
    ]
    label = "".join(
        f"<span style='height:{_TERM}px;white-space:nowrap'>{chip(colours[word])}{word}</span>"
        for word in terms
    )
    values = [_value_of(strip, row, _number) for row in terms.values()]

    def value(frame: int) -> str:
        return "".join(f"<div>{one(frame) or '&nbsp;'}</div>" for one in values)

    return Lane(
        label, height, [_ground(height), *lines], value, f"The cost's terms, to {_number(top)}"
    )


def term_rows(strip: TimelineSnapshot) -> dict[str, Floats[N]]:
    """Return the energy's parts by their words, in order; none where only silhouettes were looked at."""
    tracked = int((strip.status >= 0).sum())
    parts = {n.removeprefix(TERM): v for n, v in strip.lanes.items() if n.startswith(TERM)}
    terms = {n: v for n, v in parts.items() if np.isfinite(v).sum() > min(tracked - 1, 1)}
    seen = [name for name in terms if name != "priors"]
    if len(seen) < 2 and not {"cloud→model", "lines of sight"} & set(seen):
        return {}
    order = [name for name in TERMS if name in terms] + [n for n in terms if n not in TERMS]
    return {name: terms[name] for name in order}


def _accepted_lane(strip: TimelineSnapshot, window: Window) -> Lane | None:
    if not strip.accepted:
        return None
    marked = np.isin(np.arange(strip.start, strip.start + len(strip.status)), [*strip.accepted])
    parts = _blocks(marked.astype(float), strip.start, window, _ACCEPTED, 1.0)
    return Lane(
        "accepted", _THIN, parts, lambda f: "locked" if f in strip.accepted else "",
        "Frames that neither tracking nor refining changes.", lambda pose: "locked" if pose.accepted else "",
    )  # fmt: skip


def _take_lane(strip: TimelineSnapshot, window: Window) -> Lane | None:
    if len(strip.takes) < 2:
        return None
    order = sorted({span.take for span in strip.takes})
    parts = []
    for span in strip.takes:
        x = max(window.place(span.first) - window.half, 0.0)
        width = min(window.place(span.stop - 1) + window.half, WIDTH) - x
        if width > 0:
            colour = _TAKES[order.index(span.take) % len(_TAKES)]
            parts.append(
                f"<rect x='{x:.1f}' y='3' width='{width:.1f}' height='8' fill='{colour}'/>"
            )

    def value(frame: int) -> str:
        return next((f"take {s.take}" for s in strip.takes if s.first <= frame < s.stop), "")

    return Lane(
        "takes", _THIN, parts, value, "Which tracking shows where.", lambda pose: value(pose.frame)
    )


def _thin_lanes(strip: TimelineSnapshot, window: Window) -> list[Lane | None]:
    views, moved, found = strip.lanes.get(VIEWS), strip.lanes.get(MOVED), list[Lane | None]()
    if views is not None:
        missing = np.nanmax(views) - views
        found.append(_thin(strip, window, "views missing", missing, 1.0, _GAP, "{:.0f}", "Views that showed nothing of what is tracked."))  # fmt: skip
    if moved is not None:
        found.append(_thin(strip, window, "changed", moved, _FULL_MM, _CHANGED, "{:.1f} mm", "How far the furthest joint moved from the take below: what refining, or tracking again, changed."))  # fmt: skip
    return found


def _thin(
    strip: TimelineSnapshot, window: Window, label: str, values: Floats[N], full: float, colour: str,
    form: str, hint: str,
) -> Lane | None:  # fmt: skip
    known = np.where(np.isfinite(values), values, 0.0)
    if not (known > 0).any():
        return None
    parts = _blocks(known, strip.start, window, colour, full)
    return Lane(label, _THIN, parts, _value_of(strip, values, form.format), hint)


# ---- parts of lanes


def curve(
    values: Floats[N],
    start: int,
    window: Window,
    height: float,
    top: float | None = None,
    colour: str = "#56b4e9",
) -> list[str]:
    """Return lines through the known values, which begin at frame `start`, up to `top`, or to what nearly all are below. Of frames
    that are drawn in one place, the largest counts.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        return []
    if top is None:
        top = max(float(np.quantile(finite, 0.98)) * 1.1, 1e-12)
    place, _, highest = extremes(values, start, window)
    down = height - np.clip(np.nan_to_num(highest) / top, 0, 1) * (height - 3)
    lines = []
    for a, b in runs(np.isfinite(highest)):
        run = [f"{x:.1f},{y:.1f}" for x, y in zip(place[a:b], down[a:b], strict=True)]
        points = " ".join(run if len(run) > 1 else run * 2)
        lines.append(
            f"<polyline points='{points}' fill='none' stroke='{colour}' stroke-width='1.6' stroke-linecap='round' "
            "vector-effect='non-scaling-stroke'/>"
        )
    return lines


def bars(status: Ints[N], start: int, window: Window) -> list[str]:
    """Runs of equal status. Height tells them apart as well as colour: the worse, the taller. Of frames that are drawn in
    one place, the worst counts.
    """
    worse = np.argsort(_BADNESS)[status + 1].astype(float)  # status −1 comes first
    _, _, high = extremes(worse, start, window)
    worst = np.array(_BADNESS)[np.nan_to_num(high).astype(int)]
    found = []
    for code, x, width in _pieces(worst, window):
        height = _HEIGHTS[code]
        colour = "currentColor' opacity='.25" if code == -1 else _SHOWN_AS[code][1]
        found.append(
            f"<rect x='{x:.1f}' y='{_STATUS - height}' width='{width:.1f}' height='{height}' fill='{colour}'/>"
        )
    return found


def _blocks(values: Floats[N], start: int, window: Window, colour: str, full: float) -> list[str]:
    """Return blocks where values are above 0, in four strengths of the colour."""
    _, _, high = extremes(values, start, window)
    strength = np.ceil(4 * np.clip(np.nan_to_num(high) / full, 0.0, 1.0)).astype(int)
    return [
        f"<rect x='{x:.1f}' y='3' width='{width:.1f}' height='8' fill='{colour}' opacity='{0.25 * code:.2f}'/>"
        for code, x, width in _pieces(strength, window)
        if code
    ]


def _pieces(codes: Ints[N], window: Window) -> list[tuple[int, float, float]]:
    """Return runs of equal codes of the window's columns: code, place and width."""
    places = window.columns()
    edges = np.flatnonzero(np.diff(codes)) + 1
    found = []
    for begin, end in zip([0, *edges], [*edges, len(codes)], strict=True):
        x = max(window.place(places[begin]) - window.half, 0.0)
        right = min(window.place(places[end]) - window.half, WIDTH)
        found.append((int(codes[begin]), x, right - x))
    return found


def _grid(window: Window, height: int) -> str:
    return "".join(
        f"<path d='M{window.place(f):.1f} 0V{height + 4}' stroke='currentColor' opacity='.12' vector-effect='non-scaling-stroke'/>"
        for f in window.ticks()
    )


def _numbers(window: Window, top: int) -> str:
    return "".join(
        f"<div style='position:absolute;left:{window.place(f) / WIDTH * 100:.2f}%;top:{top + 2}px;transform:translateX(-50%);"
        f"opacity:.85;font-size:11px'>{f}</div>"
        for f in window.ticks()
    )


def _ground(height: int) -> str:
    return f"<rect width='{WIDTH}' height='{height - 2}' fill='currentColor' opacity='.05'/>"


def _diamond(x: float, found: bool) -> str:
    y, colour = _CURVE - 10, (FOUND if found else STATUS[3])[1]
    return f"<path d='M{x:.1f} {y - 7} l5 7 l-5 7 l-5 -7 z' fill='{colour}'/>"


def _legends(strip: TimelineSnapshot) -> str:
    marks = [STATUS[code] for code in (0, 1, 2, 3, 4) if _has(strip, code)]
    return "".join(
        f"<span style='margin-left:.9em'>{chip(colour)}{word}</span>"
        for word, colour in [*marks, *([FOUND] if strip.found else [])]
    )


def _has(strip: TimelineSnapshot, code: int) -> bool:
    set_by_hand = code == 3 and len(strip.by_hand) > len(strip.found)
    return set_by_hand or bool((strip.status == code).any())


def _value_of(
    strip: TimelineSnapshot, values: Floats[N], form: Callable[[float], str]
) -> Callable[[int], str]:
    def value(frame: int) -> str:
        row = frame - strip.start
        known = 0 <= row < len(values) and math.isfinite(values[row])
        return form(float(values[row])) if known else ""

    return value


def _number(value: float) -> str:
    return f"{value:.1f}" if abs(value) < 100 else f"{value:.0f}"
