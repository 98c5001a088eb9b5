"""Timeline: status and energy of every frame at a glance, the frame slider, playback."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import viser

from handtrack.arrays import Floats, Ints
from handtrack_app.page.page import Page, put
from handtrack_app.protocol.palette import FOUND, STATUS, TERMS
from handtrack_app.protocol.snapshots import SessionSnapshot, TimelineSnapshot

_PLAY: tuple[str, ...] = ("First", "Back", "Play / Pause", "Next", "Last")
_LEFT, _RIGHT = 120, 66  # [px] where viser's slider track begins and ends, so that both line up
_WIDTH, _CURVE, _BAR = 1000, 46, 12  # of the picture, in its own units
_COLUMNS = 400  # of neighbouring frames: what is sent does not grow with the recording
_MAIN_PX, _ROW_PX, _GAP_PX = (
    64,
    13,
    4,
)  # heights of the first lane, of a line of the second, and between both
_BADNESS = (-1, 0, 4, 3, 1, 2)  # status, from what is drawn least to what is drawn above all
_HEIGHTS = {-1: 3, 0: 7, 4: 7, 3: 10, 1: 10, 2: 14}


@dataclass
class TimelinePanel:
    """Handles of the timeline."""

    page: Page
    tab: viser.GuiTabHandle
    strip: TimelineSnapshot | None = None
    fps: float = 25.0
    slider: viser.GuiSliderHandle[int] | None = None
    _drawn: int | None = field(default=None)

    def __post_init__(self) -> None:
        with self.tab:
            self.picture = self.page.gui.add_html("")
            self.cursor = self.page.gui.add_html("")

    def fit(self, session: SessionSnapshot) -> None:
        """Make the timeline fit a session's frames; built once."""
        self.fps = session.fps
        if self.slider is not None:
            return
        page, gui = self.page, self.page.gui
        last = max(session.stop - 1, session.start + 1)
        with self.tab:
            self.slider = gui.add_slider("Frame", session.start, last, 1, session.first_frame)
            self.play = gui.add_button_group("Playback", _PLAY)
        page.on(self.slider, lambda event: page.go_to(page.said(event.target)))
        page.on(self.play, lambda event: self._pressed(event.target.value))

    def _pressed(self, key: str) -> None:
        state = self.page.state
        if key == _PLAY[2]:
            self.page.play(not state.playing)
            return
        self.page.play(False)
        targets = (state.start, state.frame - 1, None, state.frame + 1, state.stop - 1)
        target = dict(zip(_PLAY, targets, strict=True)).get(key)
        if target is not None:
            self.page.go_to(target)

    def show_frame(self, frame: int) -> None:
        """Move the slider and the cursor to a frame."""
        if self.slider is not None and self.slider.value != frame:
            put(self.slider, max=max(self.slider.max, frame))
            self.slider.value = frame
        self.draw()

    def show_timeline(self, strip: TimelineSnapshot) -> None:
        """Take the recording's new status and energies."""
        self.strip, self._drawn = strip, None
        if self.slider is not None:  # frames are counted, or come, while the page is open
            last = max(strip.start + len(strip.status) - 1, strip.start + 1)
            put(self.slider, min=strip.start, max=last)
        put(self.picture, content=timeline_picture(strip))
        self.draw()

    def draw(self) -> None:
        """Move the cursor to the frame shown, if something changed."""
        if self.strip is not None and self._drawn != self.page.state.frame:
            self._drawn = self.page.state.frame
            put(self.cursor, content=cursor_picture(self.strip, self._drawn))


def timeline_picture(strip: TimelineSnapshot) -> str:
    """Return the recording as SVG: the energy (or, with truth, the error) as a curve above bars of status."""
    step = _WIDTH / max(len(strip.status), 1)
    curve, title, unit = _main_curve(strip)
    parts = [
        *_curve(curve),
        *_bars(strip.status),
        *(_diamond((f - strip.start + 0.5) * step, f in strip.found) for f in strip.by_hand),
    ]
    finite = curve[np.isfinite(curve)]
    top = f"max {_number(float(finite.max()))} {unit}" if len(finite) else "nothing tracked"
    marks = [STATUS[code] for code in (0, 1, 2, 3, 4) if _has(strip, code)]
    legend = "".join(_legend(*mark) for mark in [*marks, *([FOUND] if strip.found else [])])
    return (
        f"<div class='handtrack-timeline' style='padding:.2em {_RIGHT}px 0 {_LEFT}px;position:relative;font-size:.75em'>"
        f"<div style='position:absolute;left:12px;top:1.9em;width:{_LEFT - 20}px;line-height:1.35'>{title}"
        f"<br><span style='opacity:.7'>{top}</span></div>"
        f"<div style='height:1.5em;text-align:right;opacity:.85'>{legend}</div>"
        f"{_svg(parts, _CURVE + _BAR + 6, _MAIN_PX)}</div>{_lane(strip)}"
    )


def cursor_picture(strip: TimelineSnapshot, frame: int) -> str:
    """Return what lies over the picture for the frame shown: a line, and the numbers there. It is sent for each frame."""
    here, terms = frame - strip.start, _lane_terms(strip)
    curve, _, unit = _main_curve(strip)
    now = f"{_number(float(curve[here]))} {unit}" if _is_known(curve, here) else ""
    lane = _lane_px(terms) + _GAP_PX if terms else 0
    numbers = "".join(
        f"<div>{_number(float(values[here])) if _is_known(values, here) else '&nbsp;'}</div>"
        for values in terms.values()
    )
    place = 100 * (here + 0.5) / max(len(strip.status), 1)
    return (
        "<div style='position:relative;height:0;pointer-events:none'>"
        f"<div style='position:absolute;bottom:0;height:{_MAIN_PX + lane}px;left:{_LEFT}px;right:{_RIGHT}px'>"
        f"<div style='position:absolute;left:{place:.2f}%;height:100%;border-left:2px solid currentColor'></div></div>"
        f"<div style='position:absolute;right:4px;bottom:{lane + _MAIN_PX - 26}px;width:{_RIGHT - 10}px;font-size:.75em'>"
        f"<b>{now}</b></div>"
        f"<div style='position:absolute;left:12px;bottom:0;height:{lane - _GAP_PX if lane else 0}px;width:{_LEFT - 22}px;"
        f"text-align:right;font-size:.7em;line-height:{_ROW_PX}px'>{numbers}</div></div>"
    )


def _main_curve(strip: TimelineSnapshot) -> tuple[Floats, str, str]:
    """Return the values (F,) of the first lane, what they are, and their unit."""
    if np.isfinite(strip.error_mm).any():
        return strip.error_mm, "joint error", "mm"
    return strip.energy, "energy", ""


def _svg(parts: list[str], height: int, shown_px: int) -> str:
    """Return a lane as wide as the timeline: its ground and its parts."""
    return (
        f"<svg viewBox='0 0 {_WIDTH} {height}' preserveAspectRatio='none' "
        f"style='width:100%;height:{shown_px}px;display:block'>"
        f"<rect x='0' y='0' width='{_WIDTH}' height='{_CURVE}' fill='currentColor' opacity='.05'/>{''.join(parts)}</svg>"
    )


def _is_known(values: Floats, row: int) -> bool:
    return 0 <= row < len(values) and math.isfinite(values[row])


def _lane_terms(strip: TimelineSnapshot) -> dict[str, Floats]:
    """Return the energy's parts of the second lane, in order; none where only silhouettes were looked at."""
    tracked = int((strip.status >= 0).sum())
    terms = {n: v for n, v in strip.terms.items() if np.isfinite(v).sum() > min(tracked - 1, 1)}
    seen = [name for name in terms if name != "priors"]
    if len(seen) < 2 and not {"cloud→model", "lines of sight"} & set(seen):
        return {}
    order = [name for name in TERMS if name in terms] + [n for n in terms if n not in TERMS]
    return {name: terms[name] for name in order}


def _lane_px(terms: dict[str, Floats]) -> int:
    return max(_ROW_PX * len(terms), 40)


def _lane(strip: TimelineSnapshot) -> str:
    """Return a second lane with the energy's parts, where more than silhouettes were looked at."""
    terms = _lane_terms(strip)
    if not terms:
        return ""
    finite = np.concatenate([values[np.isfinite(values)] for values in terms.values()])
    top = max(float(np.quantile(finite, 0.98)) * 1.1, 1e-12)
    lines, rows = [], ""
    for name, values in terms.items():
        colour = TERMS.get(name, "#ffffff")
        lines += _curve(values, top, colour)
        rows += f"<div style='white-space:nowrap'><span style='color:{colour}'>{name}</span></div>"
    return (
        f"<div style='padding:{_GAP_PX}px {_RIGHT}px 0 {_LEFT}px;position:relative;font-size:.7em'>"
        f"<div style='position:absolute;left:12px;top:{_GAP_PX}px;width:{_LEFT - 22}px;line-height:{_ROW_PX}px'>{rows}</div>"
        f"<div style='position:absolute;right:4px;top:{_GAP_PX}px;width:{_RIGHT - 10}px;line-height:{_ROW_PX}px;opacity:.75'>"
        f"energy<br>to {_number(top)}</div>"
        f"{_svg(lines, _CURVE, _lane_px(terms))}</div>"
    )


def _has(strip: TimelineSnapshot, code: int) -> bool:
    set_by_hand = code == 3 and len(strip.by_hand) > len(strip.found)
    return set_by_hand or bool((strip.status == code).any())


def _number(value: float) -> str:
    return f"{value:.1f}" if abs(value) < 100 else f"{value:.0f}"


def _legend(word: str, colour: str) -> str:
    return (
        f"<span style='margin-left:.9em'><span style='display:inline-block;width:.8em;height:.8em;margin-right:.3em;"
        f"border-radius:2px;background:{colour}'></span>{word}</span>"
    )


def _columns(count: int) -> Ints:
    """Return where columns of neighbouring frames begin, the end with them: at most so many that each can be seen."""
    columns = min(count, _COLUMNS)
    return np.arange(columns + 1) * count // max(columns, 1)


def _curve(values: Floats, top: float | None = None, colour: str = "#56b4e9") -> list[str]:
    """Return lines through the known values (F,), up to `top`, or to what nearly all are below. Of frames that are drawn
    in one place, the largest counts.
    """
    finite = np.isfinite(values)
    if not finite.any():
        return []
    if top is None:
        top = max(float(np.quantile(values[finite], 0.98)) * 1.1, 1e-12)
    edges = _columns(len(values))
    highest = np.maximum.reduceat(np.where(finite, values, -np.inf), edges[:-1])
    height = _CURVE - np.clip(np.where(highest > -np.inf, highest, 0.0) / top, 0, 1) * (_CURVE - 3)
    middle = (edges[:-1] + edges[1:]) / 2 * _WIDTH / len(values)
    lines, run = [], []
    for x, y, ok in zip([*middle, 0.0], [*height, 0.0], [*(highest > -np.inf), False], strict=True):
        if ok:
            run.append(f"{x:.1f},{y:.1f}")
        elif run:
            points = " ".join(run if len(run) > 1 else run * 2)
            lines.append(
                f"<polyline points='{points}' fill='none' stroke='{colour}' stroke-width='1.6' "
                "stroke-linecap='round' vector-effect='non-scaling-stroke'/>"
            )
            run = []
    return lines


def _bars(status: Ints) -> list[str]:
    """Runs of equal status. Height tells them apart as well as colour: the worse, the taller. Of frames that are drawn in
    one place, the worst counts.
    """
    places = _columns(len(status))
    worse = np.argsort(_BADNESS)[status + 1]  # status −1 comes first
    worst = np.array(_BADNESS)[np.maximum.reduceat(worse, places[:-1])] if len(status) else status
    step = _WIDTH / max(len(status), 1)
    edges = np.flatnonzero(np.diff(worst)) + 1
    bars = []
    for begin, end in zip([0, *edges], [*edges, len(worst)], strict=True):
        code = int(worst[begin])
        height = _HEIGHTS[code]
        colour = "currentColor' opacity='.25" if code == -1 else STATUS[code][1]
        x, y = places[begin] * step, _CURVE + _BAR + 4 - height
        width = places[end] * step - x
        bars.append(
            f"<rect x='{x:.1f}' y='{y}' width='{width:.1f}' height='{height}' fill='{colour}'/>"
        )
    return bars


def _diamond(x: float, found: bool) -> str:
    y, colour = _CURVE - 2, (FOUND if found else STATUS[3])[1]
    return f"<path d='M{x:.1f} {y - 7} l5 7 l-5 7 l-5 -7 z' fill='{colour}'/>"
