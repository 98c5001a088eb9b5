"""Takes: every tracking there was, to be brought back."""

from __future__ import annotations

import html
from dataclasses import dataclass

import viser

from handtrack_app.page.page import Page, put
from handtrack_app.protocol.commands import RestoreTake
from handtrack_app.protocol.snapshots import WorkSnapshot

_MOST = 40  # of the list; `handtrack takes` has all


@dataclass
class TakesPanel:
    """The end of the Track tab, once something was tracked."""

    page: Page
    tab: viser.GuiTabHandle
    folder: viser.GuiFolderHandle | None = None
    numbers: tuple[str, ...] = ()

    def _build(self, numbers: tuple[str, ...]) -> None:
        gui = self.page.gui
        with self.tab:
            self.folder = gui.add_folder("Takes", expand_by_default=False)
        with self.folder:
            self.list = gui.add_html("")
            self.chosen: viser.GuiDropdownHandle[str] = gui.add_dropdown("Take", numbers)
            self.back = gui.add_button(
                "Bring this take back", icon=viser.Icon.RESTORE, color="gray",
                hint="It becomes the whole track again. Undo takes that back; nothing is ever overwritten.",
            )  # fmt: skip
        self.page.on(self.back, lambda _: self._restore())

    def _restore(self) -> None:
        chosen = str(self.page.said(self.chosen))
        if chosen.isdigit():
            self.page.send(RestoreTake(int(chosen)))

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
        put(self.list, content=takes_table(work))
        self.numbers = numbers


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
