"""Export: files for other programs, sent to the browser."""

from __future__ import annotations

from dataclasses import dataclass

import viser

from handtrack.export.registry import AXES, FORMATS, export_format
from handtrack_app.page.page import Page
from handtrack_app.protocol.snapshots import Download

_USUAL = "csv"
_AS_RECORDED = "as recorded"
_TEXT = "<div style='padding:.1em .9em .5em;font-size:.9em;opacity:.8'>{}</div>"


@dataclass
class ExportPanel:
    """Handles of the export tab."""

    page: Page
    tab: viser.GuiTabHandle
    delivered: int = 0
    """files so far"""

    def __post_init__(self) -> None:
        gui, page = self.page.gui, self.page
        with self.tab:
            gui.add_html(_TEXT.format("What has been tracked so far, for other programs."))
            kinds = tuple(known.name for known in FORMATS)
            chosen = page.choice(
                "Format",
                kinds,
                lambda _: explain(),
                "The formats of `handtrack export --to`.",
                _USUAL,
            )
            purpose = gui.add_html("")
            up = gui.add_dropdown(
                "Up",
                (_AS_RECORDED, *AXES),
                initial_value=_AS_RECORDED,
                hint="Which of the world's axes points up: those who read this format take one for it.",
            )
            page.button(
                "Download", lambda client: download(client), "download",  # noqa: PLW0108 - it stands below
                "Written in the background, then sent.", None, by_page=True,
            )  # fmt: skip
            page.button(
                "First-frame pose (JSON)", lambda client: page.engine.export("init", client.client_id), "download",
                "The pose you see, as init.json.", by_page=True,
            )  # fmt: skip

        def explain() -> None:
            known = export_format(chosen.value)
            purpose.content = _TEXT.format(known.purpose)
            up.visible = bool(known.up)

        def download(client: viser.ClientHandle) -> None:
            axis = up.value if up.visible and up.value != _AS_RECORDED else ""
            page.engine.export(chosen.value, client.client_id, axis)

        explain()

    def deliver(self, download: Download) -> None:
        """Send a file to the client that asked for it."""
        client = self.page.server.get_clients().get(download.client_id)
        if client is not None:
            self.delivered += 1
            client.send_file_download(download.name, download.data, save_immediately=True)
            size = len(download.data) / 1024
            self.page.notify(
                "done", "Exported", f"{download.name}, {size:.0f} kB, is in your downloads.", client
            )
