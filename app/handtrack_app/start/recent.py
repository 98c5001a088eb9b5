"""The recordings that were opened last, the newest first: a file of the user's own."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

from handtrack.files.atomic import replace_text
from handtrack.files.user_folder import user_data_folder
from handtrack.session.layout import SESSION_FILE

_FILE = "recent.json"
_MOST = 12


def recent_sessions() -> list[Path]:
    """Return the folders of sessions that are still there; none where the list cannot be read."""
    with suppress(OSError, ValueError, TypeError):
        listed = json.loads((user_data_folder() / _FILE).read_text("utf-8"))
        return [path for path in map(Path, listed) if (path / SESSION_FILE).is_file()]
    return []


def remember(folder: Path) -> None:
    """Put a session's folder first; where nothing can be written, nothing is remembered."""
    known = [Path(folder).resolve(), *recent_sessions()]
    newest = [str(path) for path in dict.fromkeys(known)][:_MOST]
    with suppress(OSError):
        user_data_folder().mkdir(parents=True, exist_ok=True)
        replace_text(user_data_folder() / _FILE, json.dumps(newest, indent=1) + "\n")
