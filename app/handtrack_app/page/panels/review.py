"""Review: the intervals that are worth a look, the worst first; next, previous, accept; and a finger's angles as plots."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import viser
from viser import uplot

from handtrack.arrays import Floats, N, number_runs
from handtrack.diagnostics.review import ReviewInterval
from handtrack.store.history import Span
from handtrack_app.page.html import bar, card, picture, text, told
from handtrack_app.page.page import Client, Panel, Part, put
from handtrack_app.page.panels.pose import GuessesPanel, groups_of, title_of, unit_of
from handtrack_app.page.panels.tracking import TrackingPanel
from handtrack_app.page.timeline import Window, extremes
from handtrack_app.protocol import (
    CloseSnapshot,
    Curve,
    CurvesSnapshot,
    Notice,
    SessionSnapshot,
    TimelineSnapshot,
)

_ROWS = 8  # of the list, on one page
_GO: tuple[str, ...] = ("Previous", "Next")
_CONFIDENT = (0, 3, 4)  # of the statuses in contracts §5
_ACCEPT: tuple[str, ...] = ("Interval", "Frame", "All confident")
_LET_GO: tuple[str, ...] = ("Interval", "Frame", "All")


@dataclass
class ReviewPanel(Panel):
    """Handles of the tab."""

    at: int | None = None
    """the place in the queue that was gone to"""
    rows: list[viser.GuiButtonHandle] = field(default_factory=list)
    cards: list[viser.GuiHtmlHandle] = field(default_factory=list)
    """of the same intervals, with a picture of the worst frame: the buttons lie over them"""
    _queue: tuple[ReviewInterval, ...] = ()
    """as it was shown last"""
    _asked: tuple[ReviewInterval, ...] = ()
    """intervals whose pictures were asked for"""
    _pictures: dict[int, str] = field(default_factory=dict)
    _met: dict[tuple[int, int], None] = field(default_factory=dict)
    """intervals that were in the queue, first and last frame: those that are accepted by now are done"""

    def build(self) -> None:
        page, gui = self.page, self.gui
        self.about = gui.add_html("")
        self.off = page.reflect(gui.add_html(""), content=self._camera_words)
        self.correct = page.button(
            "Apply correction", self._correct, "tool",
            "Uses the camera corrections that joint optimisation estimated; calibration.toml stays unchanged. Then track again.",
            when=lambda: bool(self.strip.cameras_off),
        )  # fmt: skip
        self.restore = page.button(
            "Remove correction", partial(self._correct, on=False), "x",
            "Uses the original calibration. Then track again.", when=lambda: bool(self.strip.cameras_corrected),
        )  # fmt: skip
        self.head = gui.add_html("")
        self.accept_next = page.button(
            "Accept and next", partial(self.do_accept, ""), "check",
            "Accepts the interval (outside of one, the frame) and goes to the next. Key: Shift Y.", None,
            lambda: bool(self.intervals),
        )  # fmt: skip
        self.go = page.buttons(
            "Go to", _GO, lambda name: self.step(1 if name == "Next" else -1),
            "In the queue, worst first. Keys: Shift Z next, Shift U previous.", lambda: bool(self.intervals),
        )  # fmt: skip
        self.accept = page.buttons(
            "Accept", _ACCEPT, self.do_accept,
            "Accepts the selected interval, this frame, or every confident frame. Tracking and refining leave accepted frames unchanged.",
            lambda: self.strip.has_poses,
        )  # fmt: skip
        self.release = page.buttons(
            "Release", _LET_GO, self.let_go, "Tracking and refining may change these again.",
            lambda: bool(self.strip.accepted),
        )  # fmt: skip
        self.here = page.reflect(gui.add_html(""), content=self._here_words)
        for n in range(_ROWS):
            there = partial(self._is_listed, n)
            self.cards.append(page.offer(gui.add_html(""), there))
            self.rows.append(page.button("–", partial(self._chosen, n), when=there))
        self.more = gui.add_html("")
        page.watch(self._ask)
        page.key("Review: next in the queue", "shift+Z", partial(self.step, 1))
        page.key("Review: previous in the queue", "shift+U", partial(self.step, -1))
        page.key("Review: accept and next", "shift+Y", partial(self.do_accept, ""))
        page.key("Review: release the frame", "", partial(self.let_go, "Frame"))

    # ---- the queue

    @property
    def strip(self) -> TimelineSnapshot:
        return self.state.strip

    @property
    def intervals(self) -> tuple[ReviewInterval, ...]:
        """The queue."""
        return self.strip.intervals

    @property
    def current(self) -> ReviewInterval | None:
        """The stretch that was gone to, as long as the frame shown lies in it."""
        frame = self.state.frame
        if self.at is None or self.at >= len(self.intervals):
            return None
        interval = self.intervals[self.at]
        return interval if interval.first <= frame <= interval.last else None

    def step(self, by: int) -> None:
        """Go on in the queue, or back; after its end to its beginning."""
        count = len(self.intervals)
        if count:
            start = -1 if by > 0 else 0
            self.visit(((start if self.at is None else self.at) + by) % count)

    def visit(self, place: int) -> None:
        """Show the worst frame of a stretch."""
        if 0 <= place < len(self.intervals):
            self.at = place
            self.page.play(False)
            self.page.go_to(self.intervals[place].worst)
            self._show()

    def _is_listed(self, row: int) -> bool:
        return self._first_row + row < len(self.intervals)

    def _chosen(self, row: int) -> None:
        self.visit(self._first_row + row)

    @property
    def _first_row(self) -> int:
        return (self.at or 0) // _ROWS * _ROWS

    # ---- accepting

    def do_accept(self, what: str) -> None:
        """Accept the stretch, the frame shown, all that is not doubted, or, of none of these, the stretch or the frame. After a stretch
        comes the next.
        """
        interval, frame = self.current, self.state.frame
        if what == "All confident":
            good = self.strip.start + np.flatnonzero(np.isin(self.strip.status, _CONFIDENT))
            self.engine.accept(_spans({*good.tolist(), *self.strip.by_hand}))
        elif interval is not None and what != "Frame":
            self.engine.accept(((interval.first, interval.last),))
            if len(self.intervals) > 1:
                # it leaves the queue: the one after it stands in its place
                following = self.intervals[
                    (self.intervals.index(interval) + 1) % len(self.intervals)
                ]
                self.page.go_to(following.worst)
        else:
            self.engine.accept(((frame, frame),))

    def let_go(self, what: str) -> None:
        """Let frames be changed again."""
        frame, spans = self.state.frame, _spans(self.strip.accepted)
        if what == "Interval":
            spans = tuple(one for one in spans if one[0] <= frame <= one[1])
        elif what == "Frame":
            spans = ((frame, frame),)
        self.engine.accept(spans, on=False)

    def _correct(self, on: bool = True) -> None:
        known = self.strip.cameras_off if on else self.strip.cameras_corrected
        if known:
            self.engine.correct_cameras(tuple(known), on)

    # ---- showing

    def warn(self, notice: Notice) -> None:
        """Add a warning about the recording above the list, unless it stands there."""
        line = text(told(notice.text), faint=False, kind="handtrack-warning")
        if notice.of_recording and line not in self.about.content:
            self.about.content += line

    def show_timeline(self) -> None:
        """Take the queue as it is now."""
        queue, frame = self.intervals, self.state.frame
        if self.at is not None and queue != self._queue:
            places = [n for n, s in enumerate(queue) if s.first <= frame <= s.last]
            self.at = places[0] if places else min(self.at, max(len(queue) - 1, 0))
        self._queue = queue
        self._met.update(dict.fromkeys((s.first, s.last) for s in queue))
        self._show()

    @property
    def done(self) -> int:
        """How many intervals of the queue were accepted."""
        accepted = self.strip.accepted
        left = {(s.first, s.last) for s in self.intervals}
        return sum(accepted.issuperset(range(a, b + 1)) for a, b in self._met if (a, b) not in left)

    def _here_words(self) -> str:
        """Return what is to be said of the frame shown."""
        frame, interval = self.state.frame, self.current
        accepted = frame in self.strip.accepted
        said = f"<b>Frame {frame}</b> is accepted, and locked. " if accepted else ""
        if interval is not None:
            said += (
                f"<b>{str(interval).partition(',')[0]}</b>: ≈ {interval.expected:.0f} frames wrong; worst {interval.worst}: "
                f"{html.escape(interval.words)}."
            )
        return f"<div class='handtrack-queue'>{text(said, faint=False)}</div>"

    def _camera_words(self) -> str:
        """Return which cameras are off or corrected, and by how much: all of each can be changed."""
        off, corrected = self.strip.cameras_off, self.strip.cameras_corrected
        lines = [f"Estimated error of camera '{name}': {off[name]}." for name in off]
        lines += [f"Camera '{name}' is corrected by {corrected[name]}." for name in corrected]
        shown = "<br>".join(map(html.escape, lines))
        return text(shown, faint=False, kind="handtrack-warning" if off else "")

    def _show(self) -> None:
        put(self.head, content=head_words(self.strip, self.at, self.done))
        first = self._first_row
        shown = self.intervals[first : first + _ROWS]
        for n, (interval, row) in enumerate(zip(shown, self.rows, strict=False)):
            span, _, brief = str(interval).partition(", ")
            here = "handtrack-here" if first + n == self.at else ""
            image = self._pictures.get(interval.worst, "")
            put(row, label=str(interval), hint=interval.words)
            put(self.cards[n], content=card(span, (brief,), image, f"handtrack-interval {here}"))
        left = len(self.intervals) - first - _ROWS
        words = f"{first} before these, {left} after" if first else f"{left} more"
        put(self.more, content=text(words) if left > 0 or first else "")

    def _ask(self) -> None:
        """Ask for the pictures of the intervals listed, unless tracking goes on, which needs the time."""
        listed = self.intervals[self._first_row : self._first_row + _ROWS]
        if listed != self._asked and not self.state.tracking:
            self._asked = listed
            self.engine.want_close(tuple(interval.worst for interval in listed))

    def show_pictures(self, close: CloseSnapshot) -> None:
        """Show the pictures that came."""
        self._pictures = {frame: picture(image) for frame, image in close.pictures.items()}
        self._show()


def _spans(frames: Iterable[int]) -> tuple[tuple[int, int], ...]:
    """Return frames as spans of first to last."""
    return tuple((first, stop - 1) for first, stop in number_runs(frames))


def head_words(strip: TimelineSnapshot, at: int | None, done: int = 0) -> str:
    """Return how much there is to be looked at, and how much was accepted. done: intervals of the queue that are."""
    if not strip.has_poses:
        return text(
            "Track some frames first. Intervals to check are listed here, the worst first.",
            faint=False,
        )
    count, intervals = len(strip.status), len(strip.intervals)
    total = intervals + done
    share = done / total if total else 1.0
    place = (
        "" if at is None or not intervals else f"Interval {min(done + at + 1, total)} of {total} · "
    )
    look = "<b>No frames of low confidence left.</b>" if not intervals else (
        f"<b>{place}{done} of {total} accepted</b>{bar(share)}"
        "Sorted by the expected number of wrong frames."
    )  # fmt: skip
    locked_frames = len(strip.accepted)
    locked = f"<br>{locked_frames} of {count} frames {'is' if locked_frames == 1 else 'are'} accepted: neither tracking nor refining changes them." if locked_frames else ""  # fmt: skip
    return text(look + locked, faint=False)


# ---- The one next step of the work, over the timeline


Step = tuple[str, str, Callable[[Client], None]]
"""words (plain; empty where the button says it all), the button's label, and what it does"""


@dataclass
class NextStep(Part):
    """Its widgets, built where the page builds now."""

    tracking: TrackingPanel
    guesses: GuessesPanel
    review: ReviewPanel

    def build(self) -> None:
        self.words = self.gui.add_html("", visible=False)
        self.button = self.page.button("Next", self._take, color=None, by_page=True)
        self.page.watch(self._show)

    def _show(self) -> None:
        step = self._step()
        if step is not None:
            words, label, _ = step
            kind = "" if words else "handtrack-aside"
            shown = f"<div class='handtrack-next {kind}'>{html.escape(words)}</div>"
            put(self.words, content=shown)
            put(self.button, label=label)
        for widget in (self.words, self.button):
            put(widget, visible=step is not None)

    def _take(self, client: Client) -> None:
        if (step := self._step()) is not None:
            step[2](client)

    def _step(self) -> Step | None:
        """Return the step that the recording's state calls for; none while something runs."""
        state, strip, phrase = self.state, self.state.strip, self.page.phrase
        if not state.is_idle() or state.session.live:
            return None
        if strip.hidden:
            take = max(span.take for span in strip.hidden)
            return hidden_words(strip.hidden), "Show them", lambda _: self.engine.show_take(take)
        if not state.session.observed:
            return None
        if not strip.is_posed and state.session.can_be_found:
            words = phrase("No pose yet. Detect the {kind}, or drag it onto its picture.")
            return words, phrase("Detect {kind}"), lambda _: self.guesses.search(anywhere=True)
        if not strip.is_posed:
            words = phrase("No pose yet. Drag the {kind} onto its picture.")
            return words, "Open a camera view", lambda client: self.page.open_tab(client, ("View",))
        tracked = np.flatnonzero(strip.status >= 0)
        if len(tracked) < 2:
            words = phrase("The {kind} has a pose. Tracking carries it through all frames.")
            return words, "Track all", lambda _: self.tracking.start("all")
        last, stop = strip.start + int(tracked[-1]), strip.stop
        if last + 1 < stop:
            words = f"Continue from frame {last + 1}"
            return "", words, lambda _: self.tracking.track(last, stop, last)
        count = len(strip.intervals)
        if count and self.review.at is None:
            return "", f"Review {count} interval{'' if count == 1 else 's'}", self._review
        if count:
            return None
        return "", "Export …", lambda client: self.page.open_tab(client, ("More", "Export"))

    def _review(self, client: Client) -> None:
        self.page.open_tab(client, ("Review", "Queue"))
        self.review.visit(0)


def hidden_words(hidden: tuple[Span, ...]) -> str:
    """Return which tracked frames do not show, and why."""
    count = sum(span.stop - span.first for span in hidden)
    takes = sorted({span.take for span in hidden})
    named = f"take{'' if len(takes) == 1 else 's'} {', '.join(map(str, takes))}"
    does = "frame does" if count == 1 else "frames do"
    return f"{count} tracked {does} not show ({named}): tracked with another model, such as one with a forearm."


# ---- Plots: a finger's angles over the part of the recording that the timeline shows, drawn by viser's uPlot


_NONE: str = "choose …"
_CHOOSE = "Choose a {part} to plot its angles."
_GREY = "#8c8c8c"  # legible on dark and on light
_SIGMAS = 2.0
"""of the band: 19 of 20 errors, were they normal"""
_LINES = {
    "track": ("track", "#3594d6"), "low": ("−2 σ", "transparent"), "high": ("+2 σ", "transparent"), "truth": ("truth", "#009e73"),
}  # fmt: skip
"""what each is called, and its colour"""
_BANDS = (uplot.Band(series=(3, 2), fill="rgba(53,148,214,.25)"),)
"""between the lines `high` and `low`; frames come first"""
_HEIGHT = 150  # [px]


def plot_data(curve: Curve, window: Window) -> dict[str, Floats[N]]:
    """Return what is plotted of a curve by the names of its lines: frames first, then what is known, in degrees or millimetres.

    Of frames that share a column of the plot the largest value counts. `low` and `high` bound the band.
    """
    lines = {
        "track": curve.values,
        "low": curve.values - _SIGMAS * curve.std,
        "high": curve.values + _SIGMAS * curve.std,
    }
    if len(curve.truth):
        lines["truth"] = curve.truth
    edges = window.columns()
    columns = {"frame": np.floor((edges[:-1] + edges[1:] - 1) / 2)}
    for name, values in lines.items():
        _, least, most = extremes(values / unit_of(curve.name), window)
        columns[name] = least if name == "low" else most
    return columns


@dataclass
class PlotsPanel(Panel):
    """Handles of the tab."""

    window: Callable[[], Window]
    """of the timeline"""
    names: tuple[str, ...] = ()
    curves: tuple[Curve, ...] = ()
    plots: list[viser.GuiUplotHandle] = field(default_factory=list)

    def build(self) -> None:
        gui, page = self.gui, self.page
        self.group = page.choice(
            "Plot", (_NONE,), self._choose,
            "For the part of the recording that the timeline shows. The ground truth "
            "is plotted beside the track. Drag in a plot to zoom; double-click for all.",
        )  # fmt: skip
        self.note = page.offer(gui.add_html(text(page.phrase(_CHOOSE))), lambda: not self.curves)

    def fit(self, session: SessionSnapshot) -> None:
        """Offer the groups of the model's parameters."""
        if session.parameter_names != self.names:
            self.names = session.parameter_names
            self.group.options = (_NONE, *groups_of(self.names))

    def _choose(self, chosen: str) -> None:
        self.engine.want_curves(groups_of(self.names).get(chosen, ()))

    def show(self, snapshot: CurvesSnapshot) -> None:
        """Take the curves as they are now."""
        self.curves = snapshot.curves
        self.draw()

    def draw(self) -> None:
        """Plot what is chosen."""
        window = self.window()
        while len(self.plots) > len(self.curves):
            self.plots.pop().remove()
        for n, curve in enumerate(self.curves):
            data = plot_data(curve, window)
            sign = "mm" if curve.name.startswith("root_t") else "°"
            title = f"{title_of(curve.name)} [{sign}]"
            lines = tuple(np.asarray(line, np.float64) for line in data.values())
            drawn = (_series(name) for name in data if name in _LINES)
            series = (uplot.Series(label="frame"), *drawn)
            if n == len(self.plots):
                with self.tab:
                    self.plots.append(self._add(lines, series, title))
            else:
                plot = self.plots[n]
                plot.series, plot.data, plot.title = series, lines, title

    def _add(
        self, lines: tuple[Floats[N], ...], series: tuple[uplot.Series, ...], title: str
    ) -> viser.GuiUplotHandle:
        axis = uplot.Axis(
            stroke=_GREY,
            font="12px sans-serif",
            grid={"stroke": "rgba(140,140,140,.25)", "width": 1},
        )
        return self.gui.add_uplot(
            lines, series, title=title, bands=_BANDS, height=_HEIGHT, axes=(axis, axis),
            scales={"x": uplot.Scale(time=False)}, legend=uplot.Legend(show=True), padding=(10, 12, 0, 0),
        )  # fmt: skip


def _series(name: str) -> uplot.Series:
    label, colour = _LINES[name]
    return uplot.Series(
        label=label, stroke=colour, width=1.5, points={"show": False}, spanGaps=False
    )
