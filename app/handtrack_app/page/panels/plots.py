"""Plots: a finger's angles over the part of the recording that the timeline shows, drawn by viser's uPlot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import viser
from viser import uplot

from handtrack.arrays import Floats, N
from handtrack_app.page.html import text
from handtrack_app.page.page import Panel
from handtrack_app.page.panels.pose_words import groups_of, title_of, unit_of
from handtrack_app.page.time.lanes import Window, extremes
from handtrack_app.protocol.snapshots import Curve, CurvesSnapshot, SessionSnapshot

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
            "Angles of", (_NONE,), self._choose,
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
            scales={"x": uplot.Scale(time=False)}, legend=uplot.Legend(show=True), padding=(4, 12, 0, 0),
        )  # fmt: skip


def _series(name: str) -> uplot.Series:
    label, colour = _LINES[name]
    return uplot.Series(
        label=label, stroke=colour, width=1.5, points={"show": False}, spanGaps=False
    )
