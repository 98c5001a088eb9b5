"""Serving the start page."""

from __future__ import annotations

import sys
from pathlib import Path

from handtrack_app.door.access import Door, show_in_browser
from handtrack_app.door.address import FIRST_PORT, choose_port, host_warning
from handtrack_app.log import LOG_FILE, logging_to
from handtrack_app.start.start_page import StartPage


@logging_to(LOG_FILE)
def choose_recording(
    host: str, port: int, open_browser: bool, token: str | None = None, told: str = ""
) -> tuple[Path, Door] | None:
    """Serve the start page; return the folder that was chosen, and the page's door, closed. None after Ctrl-C.

    token: of the page before, which comes again by itself; told: why it does. Raises HandtrackError for a host or port that cannot be used.
    """
    warning = host_warning(host)
    if warning and token is None:
        print(f"handtrack: {warning}", file=sys.stderr)
    chosen = choose_port(host, None if port == FIRST_PORT and token is None else port)
    page = StartPage(host, chosen, token, told)
    try:
        if token is None:
            print(f"handtrack: choose a recording at {page.door.url} (Ctrl-C ends)", flush=True)
            if open_browser:
                show_in_browser(page.door)
        folder = page.wait()
        return None if folder is None else (folder, page.door)
    except KeyboardInterrupt:
        return None
    finally:
        page.stop()
