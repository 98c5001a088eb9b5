"""Live: what becomes of running cameras' images, and recording them."""

from __future__ import annotations

import html
from dataclasses import dataclass

import viser

from handtrack_app.page.page import Page, put
from handtrack_app.protocol.snapshots import LiveSnapshot, SessionSnapshot


@dataclass
class LivePanel:
    """The part of the Track tab that only running cameras have."""

    page: Page
    tab: viser.GuiTabHandle
    built: bool = False
    recording: bool = False

    def fit(self, session: SessionSnapshot) -> None:
        """Build the panel once, for a live session."""
        if self.built or not session.live:
            return
        self.built = True
        gui = self.page.gui
        with self.tab:
            self.record = gui.add_button(
                "Record", icon=viser.Icon.PLAYER_RECORD, color="gray",
                hint="Writes what the cameras show from now on, and the poses tracked in it, to a new session folder.",
            )  # fmt: skip
            self.counts = gui.add_html("")
        self.page.on(self.record, lambda _: self.page.engine.record(not self.recording))

    def show(self, live: LiveSnapshot) -> None:
        """Show the counts, and whether something is recorded."""
        if not self.built:
            return
        if self.recording != bool(live.recording):
            self.recording = bool(live.recording)
            icon = viser.Icon.PLAYER_STOP if self.recording else viser.Icon.PLAYER_RECORD
            put(self.record, label="Stop recording" if self.recording else "Record", icon=icon)
            self.record.color = "red" if self.recording else "gray"
        put(self.counts, content=live_table(live))


def live_table(live: LiveSnapshot) -> str:
    """Return a row for each camera: images tracked, dropped, missing; and what is recorded."""
    head = "".join(
        f"<th style='text-align:right;font-weight:400;opacity:.7'>{word}</th>"
        for word in ("tracked", "dropped", "missing")
    )
    rows = "".join(
        f"<tr><td>{html.escape(card.name)}</td>"
        + "".join(
            f"<td style='text-align:right'>{n}</td>"
            for n in (card.used, card.dropped, card.missing)
        )
        + "</tr>"
        + (
            f"<tr><td colspan='4' style='color:#e69f00'>{html.escape(card.gone)}</td></tr>"
            if card.gone
            else ""
        )
        for card in live.cameras
    )
    recorded = ""
    if live.recording:
        recorded = (
            f"<div style='margin-top:.4em'>Recording: {live.recorded} frames in "
            f"<span style='overflow-wrap:anywhere'>{html.escape(live.recording)}</span></div>"
        )
    return (
        "<div style='padding:.5em .9em .3em;font-size:.85em;line-height:1.4'>"
        f"<table style='width:100%'><tr><th></th>{head}</tr>{rows}</table>"
        "<div style='opacity:.7;margin-top:.3em'>Images since tracking began. Dropped: they came while an earlier frame was "
        f"still worked on.</div>{recorded}</div>"
    )
