"""The pose library by picture: a window of one page's with a button for each pose."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass
from urllib.parse import quote

from handtrack_app.page.page import Page
from handtrack_app.protocol.library import LibrarySnapshot, PosePicture

_GRID = """
.mantine-Modal-content:has(.handtrack-poses) { flex: 0 0 min(46em, 94vw) !important; }
*:has(> div > .handtrack-poses) { display: grid; grid-template-columns: repeat(9, minmax(0, 1fr)); gap: 4px; }
div:has(> .handtrack-poses) ~ div > div { padding-inline: 0 !important; }
*:has(> div > .handtrack-poses) > div:is(:has(.handtrack-wide), :last-child) { grid-column: 1 / -1; }
div:has(> .handtrack-poses) ~ div { padding: 0 !important; }
div:has(> .handtrack-poses) ~ div:not(:last-child) .mantine-Button-root { height: 92px !important; padding: 0 !important;
  background-color: rgba(128, 128, 128, .16); background-repeat: no-repeat; background-position: 50% 4px; background-size: min(66px, 96%) auto;
  color: inherit; border: 0; }
div:has(> .handtrack-poses) ~ div:not(:last-child) .mantine-Button-root:hover { background-color: rgba(128, 128, 128, .4); }
div:has(> .handtrack-poses) ~ div:not(:last-child) .mantine-Button-inner { align-items: flex-end; padding-bottom: 3px; }
div:has(> .handtrack-poses) ~ div:not(:last-child) .mantine-Button-label { height: auto; font-size: .85em; }
"""
_GROUP = "<div class='handtrack-wide' style='font-weight:600;padding-top:.3em'>{}</div>"
_PICTURE = 'div:has(> .handtrack-poses) ~ div:nth-child({place}) .mantine-Button-root {{ background-image: url("data:image/svg+xml,{svg}"); }}'


@dataclass
class Library:
    """Opens the window for a page that asked."""

    page: Page
    take: Callable[[str], None]
    """a pose was chosen, by its name"""

    def show(self, library: LibrarySnapshot) -> None:
        """Show the pictures that came to the page that asked for them."""
        client = self.page.server.get_clients().get(library.client_id)
        if client is None or not library.poses:
            return
        rows: list[str | PosePicture] = []
        for group in dict.fromkeys(pose.group for pose in library.poses):
            rows += [group, *(pose for pose in library.poses if pose.group == group)]
        modal = self.page.dialog(client, "Choose a pose")

        def choose(name: str) -> None:
            self.page.close_dialog(client)
            if self.page.state.editor in (None, client.client_id):
                self.take(name)

        with modal:
            style = "".join(
                _PICTURE.format(place=place, svg=quote(row.picture))
                for place, row in enumerate(rows, start=2)  # this text is the window's first part
                if isinstance(row, PosePicture)
            )
            client.gui.add_html(
                f"<style>{_GRID}{style}</style><b class='handtrack-poses handtrack-wide'></b>"
            )
            for row in rows:
                if isinstance(row, PosePicture):
                    button = client.gui.add_button(row.short, hint=row.title)
                    button.on_click(lambda _, name=row.name: choose(name))
                else:
                    client.gui.add_html(_GROUP.format(html.escape(row)))
            close = client.gui.add_button("Close", color="gray")
        close.on_click(lambda _: self.page.close_dialog(client))
