"""Plots: a finger's angles over the part of the recording that the timeline shows, drawn by viser's uPlot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import viser
from viser import uplot

from handtrack.arrays import Floats, N
from handtrack_app.page.html import text
from handtrack_app.page.page import Page, put
from handtrack_app.page.panels.pose_words import groups_of, title_of, unit_of
from handtrack_app.page.time.lanes import Window, extremes
from handtrack_app.protocol.snapshots import Curve, CurvesSnapshot, SessionSnapshot

_NONE: str = "choose …"
_CHOOSE = "Choose a {part} to plot its angles."
_TRACK, _BAND, _OTHER, _TRUTH = "#3594d6", "rgba(53,148,214,.25)", "#e69f00", "#009e73"
_GREY = "#8c8c8c"  # legible on dark and on light
_SIGMAS = 2.0
"""of the band: 19 of 20 errors, were they normal"""
_HEIGHT = 150  # [px]


def plot_data(snapshot: CurvesSnapshot, curve: Curve, window: Window) -> dict[str, Floats[N]]:
    """Return what is plotted of a curve by the names of its lines: frames first, then what is known, in degrees or millimetres.

    Of frames that share a column of the plot the largest value counts. `low` and `high` bound the band.
    """
    unit, start = unit_of(curve.name), snapshot.start
    lines = {
        "track": curve.values,
        "low": curve.values - _SIGMAS * curve.std,
        "high": curve.values + _SIGMAS * curve.std,
    }
    if len(curve.truth):
        lines["truth"] = curve.truth
    edges = window.columns()
    found = {"frame": np.floor((edges[:-1] + edges[1:] - 1) / 2)}
    for name, values in lines.items():
        shown = np.where(np.isfinite(values), values, np.nan) / unit
        _, least, most = extremes(shown, start, window)
        found[name] = least if name == "low" else most
    return found


@dataclass
class PlotsPanel:
    """Handles of the tab."""

    page: Page
    tab: viser.GuiTabHandle
    window: Callable[[], Window]
    """of the timeline"""
    names: tuple[str, ...] = ()
    snapshot: CurvesSnapshot | None = None
    plots: list[viser.GuiUplotHandle] = field(default_factory=list)
    _drawn: tuple[object, ...] = ()

    def __post_init__(self) -> None:
        gui, page = self.page.gui, self.page
        with self.tab:
            self.group = page.choice(
                "Angles of", (_NONE,), self._choose,
                "For the part of the recording that the timeline shows. The ground truth "
                "is plotted beside the track. Drag in a plot to zoom; double-click for all.",
            )  # fmt: skip
            self.note = gui.add_html(text(page.say(_CHOOSE)))

    def fit(self, session: SessionSnapshot) -> None:
        """Offer the groups of the model's parameters."""
        if session.parameter_names != self.names:
            self.names = session.parameter_names
            self.group.options = (_NONE, *groups_of(self.names))

    def _choose(self, chosen: str) -> None:
        self.page.engine.want_curves(groups_of(self.names).get(chosen, ()))

    def show(self, snapshot: CurvesSnapshot) -> None:
        """Take the curves as they are now."""
        self.snapshot = snapshot
        self.draw()

    def draw(self) -> None:
        """Plot what is chosen, if something changed."""
        snapshot, window = self.snapshot, self.window()
        if snapshot is None or (snapshot, window) == self._drawn:
            return
        self._drawn = snapshot, window
        for plot in self.plots[len(snapshot.curves) :]:
            plot.remove()
        del self.plots[len(snapshot.curves) :]
        for n, curve in enumerate(snapshot.curves):
            data = plot_data(snapshot, curve, window)
            sign = "mm" if curve.name.startswith("root_t") else "°"
            title, series = f"{title_of(curve.name)} [{sign}]", _series(data)
            if n == len(self.plots):
                with self.tab:
                    self.plots.append(self._add(data, series, title))
                continue
            plot = self.plots[n]
            plot.series, plot.bands = series, _bands(data)
            plot.data = tuple(np.asarray(line, np.float64) for line in data.values())
            plot.title = title
        put(self.note, visible=not snapshot.curves)

    def _add(
        self, data: dict[str, Floats[N]], series: tuple[uplot.Series, ...], title: str
    ) -> viser.GuiUplotHandle:
        axis = uplot.Axis(
            stroke=_GREY,
            font="12px sans-serif",
            grid={"stroke": "rgba(140,140,140,.25)", "width": 1},
        )
        return self.page.gui.add_uplot(
            tuple(data.values()), series, title=title, bands=_bands(data), height=_HEIGHT, axes=(axis, axis),
            scales={"x": uplot.Scale(time=False)}, legend=uplot.Legend(show=True), padding=(4, 12, 0, 0),
        )  # fmt: skip


def _series(data: dict[str, Floats[N]]) -> tuple[uplot.Series, ...]:
    found = [uplot.Series(label="frame")]
    for name in list(data)[1:]:
        colour = {"track": _TRACK, "truth": _TRUTH, "low": "transparent", "high": "transparent"}
        found.append(uplot.Series(
            label={"low": "−2 σ", "high": "+2 σ"}.get(name, name), stroke=colour.get(name, _OTHER), width=1.5,
            points={"show": False}, spanGaps=False,
        ))  # fmt: skip
    return tuple(found)


def _bands(data: dict[str, Floats[N]]) -> tuple[uplot.Band, ...]:
    names = list(data)
    if "low" not in names:
        return ()
    return (uplot.Band(series=(names.index("high"), names.index("low")), fill=_BAND),)
