"""Opening the page in the user's browser without its token on a command line, which every user of a machine can read."""

from __future__ import annotations

import html
import os
import webbrowser
from contextlib import suppress

from handtrack.files.user_folder import user_data_folder
from handtrack_app.door.door import Door


def show_in_browser(door: Door) -> None:
    """Have the user's browser open a file that leads to the page. Only the user can read it; it goes when the page has come."""
    path = user_data_folder() / f"open-{door.port}.html"
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    address = html.escape(door.url)
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(
            f'<!doctype html><title>handtrack</title><meta http-equiv="refresh" content="0; url={address}">'
            f'<p><a href="{address}">handtrack</a>\n'
        )

    def take_away() -> None:
        with suppress(OSError):
            path.unlink(missing_ok=True)

    door.handshake.hide_address = take_away
    webbrowser.open(path.resolve().as_uri())
