"""The journal in which earlier versions of the workbench kept their work; it is only read."""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from handtrack.session.layout import JOURNAL_FILE

_KEYS = {"time_s", "kind", "data"}
_SUM_KEY = ',"crc":"'  # ends a line: CRC-32 of what stands before it


@dataclass(frozen=True)
class Event:
    """One accepted change."""

    kind: str
    """a word of the one who wrote it, such as `pose`, `setting`, `tracked`"""
    data: dict[str, Any]
    time_s: float
    """when it was accepted [s since 1970]"""


def read_events(session_folder: Path) -> list[Event]:
    """Return the events of a session's journal, the oldest first; lines that cannot be read are passed over."""
    path = Path(session_folder) / JOURNAL_FILE
    if not path.is_file():
        return []
    lines = path.read_bytes().splitlines()
    return [event for line in lines if (event := _event(line)) is not None]


def _checksum(text: bytes) -> str:
    return f"{zlib.crc32(text):08x}"


def _event(line: bytes) -> Event | None:
    """Return what a line says, None of a damaged one. Those of earlier versions have no checksum, and nothing in its place."""
    text, found, checksum = line.rpartition(_SUM_KEY.encode())
    if found and checksum != f'{_checksum(text)}"}}'.encode():
        return None
    try:
        entry = json.loads(line)
        if set(entry) != (_KEYS | {"crc"} if found else _KEYS):
            return None
        return Event(str(entry["kind"]), dict(entry["data"]), float(entry["time_s"]))
    except (ValueError, KeyError, TypeError):
        return None
