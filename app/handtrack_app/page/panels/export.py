"""Export: files for other programs, sent to the browser."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from handtrack.export.registry import AXES, FORMATS, ExportFormat
from handtrack_app.page.html import escaped
from handtrack_app.page.page import Client, Panel
from handtrack_app.protocol import Download

_AS_RECORDED = "as recorded"
_BY_COMMAND = "mano"
"""the format that takes a file of the user's own, which `handtrack export` is given"""


@dataclass
class ExportPanel(Panel):
    """Handles of the export tab."""

    delivered: int = 0
    """files so far"""

    def build(self) -> None:
        gui, page = self.gui, self.page
        gui.add_html(escaped("Exports the frames tracked so far for other programs."))
        self.up = gui.add_dropdown(
            "Up axis",
            (_AS_RECORDED, *AXES),
            initial_value=_AS_RECORDED,
            hint="The axis of the calibration's world that points up. Where a file format has an up axis of its own, the motion is rotated to stand upright.",
        )
        page.button(
            "First-frame pose (JSON)", lambda client: page.engine.export("init", client.handle.client_id), "download",
            "Downloads the pose you see as init.json. The session stays as it is.", by_page=True,
        )  # fmt: skip
        offered = [known for known in FORMATS if known.name != _BY_COMMAND]
        for group in dict.fromkeys(known.group for known in offered):
            with gui.add_folder(group, expand_by_default=group == offered[0].group):
                gui.add_html("<div class='handtrack-queue'></div>")
                for known in offered:
                    if known.group == group:
                        act = partial(self._download, known)
                        page.button(card_words(known), act, "download", by_page=True)

    def _download(self, known: ExportFormat, client: Client) -> None:
        axis = self.up.value if known.up and self.up.value != _AS_RECORDED else ""
        self.engine.export(known.name, client.handle.client_id, axis)

    def deliver(self, download: Download) -> None:
        """Send a file to the client that asked for it; viser says there that it came."""
        if (client := self.page.by_number.get(download.client_id)) is not None:
            self.delivered += 1
            client.handle.send_file_download(download.name, download.data, save_immediately=True)


def card_words(known: ExportFormat) -> str:
    """Return what a format is for, its units and axes."""
    axes = f"readers expect {known.up} up" if known.up else "axes as calibrated"
    return f"{known.name}: {known.purpose}" + (f" [{known.units}; {axes}]" if known.units else "")
