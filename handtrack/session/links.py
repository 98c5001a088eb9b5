"""Files that a session names outside of its folder: only where this user linked them there, on this computer.

A session that somebody sends may name any path, so what it says itself counts for nothing; the list is the user's own.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.files.atomic import replace_text
from handtrack.files.user_folder import user_data_folder

_FILE = "links.json"


def linked_folders(session: Path) -> list[str]:
    """Return the folders outside of a session's that it may read, as absolute paths."""
    return _links().get(str(session.resolve()), [])


def allow_links(session: Path, folders: Iterable[Path]) -> None:
    """Let a session read files of these folders, from now on and for this user.

    Raises HandtrackError where that cannot be kept.
    """
    links = {name: known for name, known in _links().items() if Path(name).is_dir()}
    links[str(session.resolve())] = sorted({str(folder.resolve()) for folder in folders})
    path = user_data_folder() / _FILE
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_text(path, json.dumps(links, indent=1) + "\n")
    except OSError as error:
        raise HandtrackError(
            f"{path}: cannot be written ({error.strerror}), so no links can be allowed. Copy the files: leave --link away."
        ) from None


def _links() -> dict[str, list[str]]:
    """Return the list; one that is damaged allows nothing."""
    try:
        read = json.loads((user_data_folder() / _FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return {
        name: [folder for folder in folders if isinstance(folder, str)]
        for name, folders in (read.items() if isinstance(read, dict) else ())
        if isinstance(folders, list)
    }
