"""Export: files for other programs, sent to the browser."""

from __future__ import annotations

from dataclasses import dataclass

import viser

from handtrack_app.page.page import Page
from handtrack_app.protocol.commands import Export
from handtrack_app.protocol.snapshots import Download

_KINDS = {
    "Joint angles and positions (CSV)": ("csv", "One row a frame; opens in any spreadsheet."),
    "Everything (NPZ)": ("npz", "Bone poses, angles, uncertainty and status, for Python."),
    "First-frame pose (JSON)": ("init", "The pose you see, as init.json."),
}


@dataclass
class ExportPanel:
    """Handles of the export tab."""

    page: Page
    tab: viser.GuiTabHandle

    def __post_init__(self) -> None:
        gui, page = self.page.gui, self.page
        with self.tab:
            gui.add_html(
                "<div style='padding:.5em .9em .2em;font-size:.85em;opacity:.75'>Downloads what has been tracked so far. "
                "More formats: <code>handtrack export --help</code>.</div>"
            )
            for label, (kind, hint) in _KINDS.items():
                button = gui.add_button(label, icon=viser.Icon.DOWNLOAD, color="gray", hint=hint)
                page.on(
                    button, lambda event, kind=kind: page.send(Export(kind, event.client_id or 0))
                )

    def deliver(self, download: Download) -> None:
        """Send a file to the client that asked for it."""
        client = self.page.server.get_clients().get(download.client_id)
        if client is not None:
            client.send_file_download(download.name, download.data, save_immediately=True)
            size = len(download.data) / 1024
            self.page.notify(
                "done", "Exported", f"{download.name}, {size:.0f} kB, is in your downloads.", client
            )
