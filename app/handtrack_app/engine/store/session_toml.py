"""Changes of session.toml from the page: the file before is kept, and what cannot be done is told in words."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.files.atomic import replace_text
from handtrack.files.text_files import read_text
from handtrack.files.toml_text import read_toml
from handtrack.files.versions import keep_version

_WHAT = "a session's settings"


def change_session_toml(path: Path, changed: Callable[[str], str]) -> str:
    """Put `changed(text)` in the place of a session.toml's text, whole or not at all; return a sentence about the
    file before, empty where nothing changed.

    Raises HandtrackError for a file that is no valid TOML by now, or that cannot be read or written.
    """
    read_toml(path, _WHAT)
    before = read_text(path, _WHAT)
    after = changed(before)
    if after == before:
        return ""
    try:
        previous = keep_version(path)
        replace_text(path, after)
    except OSError as error:
        raise HandtrackError(
            f"{path}: cannot be written ({error.strerror}). Is the folder read-only?"
        ) from None
    return f" The file before is kept as versions/{previous.name}." if previous else ""
