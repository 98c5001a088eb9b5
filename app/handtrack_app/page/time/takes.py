"""Takes: every tracking there was; compared with the track, brought back whole or in part."""

from __future__ import annotations

import html
from dataclasses import dataclass

import numpy as np
import viser

from handtrack_app.page.page import Page, put
from handtrack_app.protocol.snapshots import WorkSnapshot
from handtrack_app.protocol.timeline import APART, TimelineSnapshot

_MOST = 40  # of the list; `handtrack takes` has all
_NONE: str = "none"


@dataclass
class TakesPanel:
    """The end of the Track tab, once something was tracked."""

    page: Page
    tab: viser.GuiTabHandle
    folder: viser.GuiFolderHandle | None = None
    numbers: tuple[str, ...] = ()
    strip: TimelineSnapshot | None = None

    def _build(self, numbers: tuple[str, ...]) -> None:
        gui, state = self.page.gui, self.page.state
        with self.tab:
            self.folder = gui.add_folder("Takes", expand_by_default=False)
        with self.folder:
            self.list = gui.add_html("")
            self.compare: viser.GuiDropdownHandle[str] = gui.add_dropdown(
                "Compare to", (_NONE, *numbers), initial_value=_NONE,
                hint="It stands in the scene as a yellow skeleton, a lane says how far it is, the plots have its curves.",
            )  # fmt: skip
            self.apart = gui.add_html("")
            self.chosen: viser.GuiDropdownHandle[str] = gui.add_dropdown("Take", numbers)
            self.back = gui.add_button(
                "Bring this take back", icon=viser.Icon.RESTORE, color="gray",
                hint="It becomes the whole track again, but for accepted frames. Undo takes that back; nothing is ever overwritten.",
            )  # fmt: skip
            last = max(state.stop - 1, state.start + 1)
            self.span: viser.GuiMultiSliderHandle[int] = gui.add_multi_slider(
                "Frames", state.start, last, 1, initial_value=(state.start, last), min_range=0
            )
            self.part = gui.add_button(
                "Bring these frames back", icon=viser.Icon.ARROWS_HORIZONTAL, color="gray",
                hint="From this take; all others stay.",
            )  # fmt: skip
        self.page.on(self.back, lambda _: self._restore(None))
        self.page.on(self.part, lambda _: self._restore(self.frames))
        self.page.on(self.compare, lambda event: self._compare(str(event.value)))
        self.span.on_update(lambda _: self._name_span())
        self._name_span()

    @property
    def frames(self) -> tuple[int, int]:
        """The chosen frames, first to last."""
        state = self.page.state
        found = [f for f in map(state.clamp_frame, map(float, self.span.value)) if f is not None]
        return (min(found), max(found)) if found else (state.start, state.stop - 1)

    def _name_span(self) -> None:
        first, last = self.frames
        self.span.label = f"{first}\u2060…\u2060{last}"

    def _restore(self, span: tuple[int, int] | None) -> None:
        chosen = str(self.page.said(self.chosen))
        if chosen.isdecimal():
            self.page.play(False)
            self.page.engine.restore_take(int(chosen), span)

    def _compare(self, chosen: str) -> None:
        self.page.engine.compare_take(int(chosen) if chosen.isdecimal() else None)

    def show(self, work: WorkSnapshot) -> None:
        """Show the takes that there are."""
        if not work.takes:
            return
        numbers = tuple(str(card.number) for card in work.takes[:_MOST])
        if self.folder is None:
            self._build(numbers)
        elif numbers != self.numbers:
            self.chosen.options = numbers
            self.chosen.value = numbers[0]
            compared = self.compare.value
            self.compare.options = (_NONE, *numbers)
            self.compare.value = compared if compared in numbers else _NONE
        put(self.list, content=takes_table(work))
        self.numbers = numbers

    def show_timeline(self, strip: TimelineSnapshot) -> None:
        """Say how far the take that is compared lies from the track."""
        if self.folder is not None:
            put(self.apart, content=apart_words(strip))
            last = max(strip.start + len(strip.status) - 1, strip.start + 1)
            put(self.span, min=strip.start, max=last)


def apart_words(strip: TimelineSnapshot) -> str:
    """Return how far the take that is compared lies from the track; empty where none is."""
    apart = strip.lanes.get(APART)
    if apart is None or not np.isfinite(apart).any():
        return ""
    known = apart[np.isfinite(apart)]
    worst = strip.start + int(np.nanargmax(apart))
    return (
        "<div style='padding:.1em .9em .4em;font-size:.8em;line-height:1.4'>The furthest joint lies "
        f"<b>{np.median(known):.1f} mm</b> away in half of {len(known)} frames, most in frame {worst} "
        f"(<b>{known.max():.1f} mm</b>).</div>"
    )


def takes_table(work: WorkSnapshot) -> str:
    """Return a row for each take, the latest first."""
    rows = ""
    for card in work.takes[:_MOST]:
        shown = (
            f"<b>{card.shown} {'frame' if card.shown == 1 else 'frames'} shown</b>"
            if card.shown
            else ""
        )
        rows += (
            f"<tr><td style='vertical-align:top;padding-right:.8em'><b>{card.number}</b></td>"
            f"<td>{html.escape(card.words)} {shown}</td></tr>"
        )
    return f"<table style='padding:.2em .9em;font-size:.8em;line-height:1.4'>{rows}</table>"
