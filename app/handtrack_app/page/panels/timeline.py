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


@dataclass
class TimelinePanel:
    """Handles of the timeline."""

    page: Page
    tab: viser.GuiTabHandle
    strip: TimelineSnapshot | None = None
    fps: float = 25.0
    slider: viser.GuiSliderHandle[int] | None = None
    _drawn: tuple[int, int] | None = field(default=None)

    def __post_init__(self) -> None:
        with self.tab:
            self.picture = self.page.gui.add_html("")

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
        page.on(self.slider, lambda event: page.go_to(event.target.value))
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
        self.draw()

    def draw(self) -> None:
        """Draw the strip with its cursor, if something changed."""
        if self.strip is None:
            return
        drawn = (id(self.strip), self.page.state.frame)
        if drawn != self._drawn:
            self._drawn = drawn
            self.picture.content = timeline_picture(self.strip, self.page.state.frame)


def timeline_picture(strip: TimelineSnapshot, frame: int) -> str:
    """Return the recording as SVG: the energy (or, with truth, the error) as a curve above bars of status."""
    count = max(len(strip.status), 1)
    step, here = _WIDTH / count, frame - strip.start
    known_error = bool(np.isfinite(strip.error_mm).any())
    curve, unit = (strip.error_mm, "mm") if known_error else (strip.energy, "")
    title = "joint error" if known_error else "energy"
    parts = [
        *_curve(curve, step),
        *_bars(strip.status, step),
        *(_diamond((f - strip.start + 0.5) * step, f in strip.found) for f in strip.by_hand),
    ]
    finite = curve[np.isfinite(curve)]
    top = f"max {_number(float(finite.max()))} {unit}" if len(finite) else "nothing tracked"
    now = f"{_number(float(curve[here]))} {unit}" if _is_known(curve, here) else ""
    marks = [STATUS[code] for code in (0, 1, 2, 3, 4) if _has(strip, code)]
    legend = "".join(_legend(*mark) for mark in [*marks, *([FOUND] if strip.found else [])])
    return (
        f"<div class='handtrack-timeline' style='padding:.2em {_RIGHT}px 0 {_LEFT}px;position:relative;font-size:.75em'>"
        f"<div style='position:absolute;left:12px;top:1.9em;width:{_LEFT - 20}px;line-height:1.35'>{title}"
        f"<br><span style='opacity:.7'>{top}</span></div>"
        f"<div style='position:absolute;right:4px;top:1.9em;width:{_RIGHT - 10}px'><b>{now}</b></div>"
        f"<div style='height:1.5em;text-align:right;opacity:.85'>{legend}</div>"
        f"{_svg(parts, (here + 0.5) * step, _CURVE + _BAR + 6, 64)}</div>{_lane(strip, frame)}"
    )


def _svg(parts: list[str], cursor: float, height: int, shown_px: int) -> str:
    """Return a lane as wide as the timeline: its ground, its parts, and the line of the frame shown."""
    return (
        f"<svg viewBox='0 0 {_WIDTH} {height}' preserveAspectRatio='none' "
        f"style='width:100%;height:{shown_px}px;display:block'>"
        f"<rect x='0' y='0' width='{_WIDTH}' height='{_CURVE}' fill='currentColor' opacity='.05'/>{''.join(parts)}"
        f"<line x1='{cursor:.1f}' x2='{cursor:.1f}' y1='0' y2='{height}' stroke='currentColor' stroke-width='2' "
        "vector-effect='non-scaling-stroke'/></svg>"
    )


def _is_known(values: Floats, row: int) -> bool:
    return 0 <= row < len(values) and math.isfinite(values[row])


def _lane(strip: TimelineSnapshot, frame: int) -> str:
    """Return a second lane with the energy's parts, where more than silhouettes were looked at."""
    tracked = int((strip.status >= 0).sum())
    terms = {n: v for n, v in strip.terms.items() if np.isfinite(v).sum() > min(tracked - 1, 1)}
    seen = [name for name in terms if name != "priors"]
    if len(seen) < 2 and not {"cloud→model", "lines of sight"} & set(seen):
        return ""
    order = [name for name in TERMS if name in terms] + [n for n in terms if n not in TERMS]
    step, here = _WIDTH / max(len(strip.status), 1), frame - strip.start
    finite = np.concatenate([terms[name][np.isfinite(terms[name])] for name in order])
    top = max(float(np.quantile(finite, 0.98)) * 1.1, 1e-12)
    lines, rows = [], ""
    for name in order:
        colour, values = TERMS.get(name, "#ffffff"), terms[name]
        lines += _curve(values, step, top, colour)
        shown = _number(float(values[here])) if _is_known(values, here) else ""
        rows += (
            f"<div style='display:flex;justify-content:space-between;white-space:nowrap'><span style='color:{colour}'>{name}</span>"
            f"<span>{shown}</span></div>"
        )
    return (
        f"<div style='padding:.35em {_RIGHT}px 0 {_LEFT}px;position:relative;font-size:.7em'>"
        f"<div style='position:absolute;left:12px;top:.2em;width:{_LEFT - 22}px;line-height:13px'>{rows}</div>"
        f"<div style='position:absolute;right:4px;top:.2em;width:{_RIGHT - 10}px;line-height:13px;opacity:.75'>"
        f"energy<br>to {_number(top)}</div>"
        f"{_svg(lines, (here + 0.5) * step, _CURVE, max(13 * len(order), 40))}</div>"
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


def _curve(
    values: Floats, step: float, top: float | None = None, colour: str = "#56b4e9"
) -> list[str]:
    """Return lines through the known values (F,), up to `top`, or to what nearly all are below."""
    finite = np.isfinite(values)
    if not finite.any():
        return []
    if top is None:
        top = max(float(np.quantile(values[finite], 0.98)) * 1.1, 1e-12)
    height = _CURVE - np.clip(np.nan_to_num(values) / top, 0, 1) * (_CURVE - 3)
    lines, run = [], []
    for i, ok in enumerate([*finite.tolist(), False]):
        if ok:
            run.append(f"{(i + 0.5) * step:.1f},{height[i]:.1f}")
        elif run:
            points = " ".join(run if len(run) > 1 else run * 2)
            lines.append(
                f"<polyline points='{points}' fill='none' stroke='{colour}' stroke-width='1.6' "
                "stroke-linecap='round' vector-effect='non-scaling-stroke'/>"
            )
            run = []
    return lines


def _bars(status: Ints, step: float) -> list[str]:
    """Runs of equal status. Height tells them apart as well as colour: the worse, the taller."""
    heights = {-1: 3, 0: 7, 4: 7, 3: 10, 1: 10, 2: 14}
    edges = np.flatnonzero(np.diff(status)) + 1
    bars = []
    for begin, end in zip([0, *edges], [*edges, len(status)], strict=True):
        code = int(status[begin])
        height = heights.get(code, 7)
        colour = "currentColor' opacity='.25" if code == -1 else STATUS[code][1]
        y = _CURVE + _BAR + 4 - height
        bars.append(
            f"<rect x='{begin * step:.1f}' y='{y}' width='{(end - begin) * step:.1f}' height='{height}' fill='{colour}'/>"
        )
    return bars


def _diamond(x: float, found: bool) -> str:
    y, colour = _CURVE - 2, (FOUND if found else STATUS[3])[1]
    return f"<path d='M{x:.1f} {y - 7} l5 7 l-5 7 l-5 -7 z' fill='{colour}'/>"
