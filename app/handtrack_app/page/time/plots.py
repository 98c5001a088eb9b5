"""Plots: the course of a finger's angles over the part of the recording that the timeline shows; saved as SVG or PNG."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import viser

from handtrack_app.page.page import Page, UserEvent, put
from handtrack_app.page.panels.pose_words import groups_of
from handtrack_app.page.time.plot import plots
from handtrack_app.page.time.window import Window
from handtrack_app.protocol.commands import WantCurves
from handtrack_app.protocol.comparing import CurvesSnapshot
from handtrack_app.protocol.snapshots import Download, SessionSnapshot

_NONE: str = "choose …"
_CHOOSE = "Choose a {part} to see the course of its angles."
_PAGE = 282.0, 104.0  # width, and height of each plot, on the page
_FILE = 900.0, 190.0  # and in a file


@dataclass
class PlotsPanel:
    """Handles of the tab."""

    page: Page
    tab: viser.GuiTabHandle
    window: Callable[[], Window]
    """of the timeline"""
    deliver: Callable[[Download], None]
    names: tuple[str, ...] = ()
    snapshot: CurvesSnapshot | None = None
    _drawn: tuple[object, ...] = ()

    def __post_init__(self) -> None:
        gui, page = self.page.gui, self.page
        with self.tab:
            self.group: viser.GuiDropdownHandle[str] = gui.add_dropdown(
                "Angles of", (_NONE,), initial_value=_NONE,
                hint="In the part of the recording that the timeline shows. The take that is compared (Track, Takes) and the truth "
                "stand beside the track.",
            )  # fmt: skip
            self.speed = gui.add_checkbox("Speed", False, hint="Of the angle, instead of it.")
            self.save = gui.add_button_group("Save as", ("SVG", "PNG"), visible=False)
            self.picture = gui.add_html("")
        page.words.on(self.picture, content=_words(_CHOOSE))
        page.on(self.group, lambda _: self._choose())
        page.on(self.speed, lambda _: self.draw())
        page.on(self.save, self._save)

    def fit(self, session: SessionSnapshot) -> None:
        """Offer the groups of the model's parameters."""
        if session.parameter_names != self.names:
            self.names = session.parameter_names
            self.group.options = (_NONE, *groups_of(self.names))

    def _choose(self) -> None:
        chosen = str(self.page.said(self.group))
        self.page.send(WantCurves(groups_of(self.names).get(chosen, ())))

    def show(self, snapshot: CurvesSnapshot) -> None:
        """Take the courses as they are now."""
        self.snapshot = snapshot
        self.draw()

    def draw(self) -> None:
        """Draw what is wanted, if something changed."""
        window, speed = self.window(), bool(self.speed.value)
        now = self.snapshot, window, speed
        if self.snapshot is None or now == self._drawn:
            return
        self._drawn = now
        there = bool(self.snapshot.curves)
        put(self.save, visible=there)
        if not there:
            put(self.picture, content=_words(self.page.words.of(_CHOOSE)))
            return
        svg = plots(self.snapshot, window, speed, *_PAGE).svg("currentColor")
        put(self.picture, content=f"<div style='padding:.2em .6em'>{svg}</div>")

    def _save(self, event: UserEvent) -> None:
        kind = str(event.target.value)
        if self.snapshot is None or not self.snapshot.curves or event.client_id is None:
            return
        window, speed = self.window(), bool(self.speed.value)
        drawing = plots(self.snapshot, window, speed, *_FILE)
        data = drawing.png() if kind == "PNG" else drawing.svg(ground="#ffffff").encode()
        group = str(self.page.said(self.group)).lower()
        name = f"{group}_{'speed' if speed else 'angles'}_{window.first}_{window.last}.{kind.lower()}"  # fmt: skip
        self.deliver(Download(name, data, event.client_id))


def _words(text: str) -> str:
    return f"<div style='padding:.5em .9em .3em;font-size:.85em;opacity:.75'>{text}</div>"
