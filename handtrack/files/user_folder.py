"""Where handtrack keeps what is a user's own."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def user_data_folder() -> Path:
    """Return where handtrack keeps a user's own copies: HANDTRACK_HOME, else the system's place."""
    chosen = os.environ.get("HANDTRACK_HOME")
    if chosen:
        return Path(chosen)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", "~/AppData/Local")).expanduser() / "handtrack"
    if sys.platform == "darwin":
        return Path("~/Library/Application Support/handtrack").expanduser()
    return Path(os.environ.get("XDG_DATA_HOME") or "~/.local/share").expanduser() / "handtrack"
