"""The journal: every accepted change of a session, appended at once, so that a crash loses nothing."""

from __future__ import annotations

import json
import os
import threading
import time
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.files.atomic import replace_text
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


class Journal:
    """Events of a session in tracks/journal.jsonl, one JSON line each. Safe from several threads."""

    def __init__(self, path: Path, known: list[Event], damaged: int) -> None:
        """Use `Journal.open`."""
        self.path = path
        self.damaged = damaged
        """lines that could not be read and were passed over; a last line torn by a crash is one."""
        self._known = known
        self._lock = threading.Lock()
        self._file = path.open("ab", buffering=0)

    @classmethod
    def open(cls, session_folder: Path) -> Journal:
        """Return the journal of a session, with what was written before. Makes the file if need be.

        A last line that a crash tore off is dropped from the file: what was accepted before it stands.
        Raises HandtrackError when it cannot be written.
        """
        path = Path(session_folder) / JOURNAL_FILE
        try:
            path.parent.mkdir(exist_ok=True)
            known, damaged = _mended(path)
            return cls(path, known, damaged)
        except OSError as error:
            raise HandtrackError(
                f"{path}: the journal cannot be written ({error.strerror}), so work on this session would "
                "be lost in a crash. Make the folder writable, or copy the session to one that is."
            ) from None

    def append(self, kind: str, data: dict[str, Any]) -> None:
        """Write one event; it is on disk when this returns. NumPy arrays become lists."""
        self.append_all([(kind, data)])

    def append_all(self, events: Iterable[tuple[str, dict[str, Any]]]) -> None:
        """Write several events at the price of one."""
        made = [Event(kind, json.loads(_text(data)), time.time()) for kind, data in events]
        if not made:
            return
        with self._lock:
            self._write("".join(_line(event) for event in made).encode())
            self._known.extend(made)

    def _write(self, lines: bytes) -> None:
        """Write all of it or, when the disk is full or gone, none of it."""
        handle = self._file.fileno()
        end = os.fstat(handle).st_size
        try:
            rest = memoryview(lines)
            while rest:
                rest = rest[os.write(handle, rest) :]
            os.fsync(handle)
        except OSError as error:
            os.ftruncate(handle, end)  # half a line must not spoil the next one
            raise HandtrackError(
                f"{self.path}: the last change could not be written ({error.strerror}), so it would be "
                "lost in a crash. Free some space on that disk; the next change will be tried again."
            ) from None

    def events(self) -> list[Event]:
        """Return all events, the oldest first: those found when opened, and those appended since."""
        with self._lock:
            return list(self._known)

    def replace(self, events: Iterable[Event]) -> None:
        """Put these events in the place of all, whole or not at all: shortens a journal."""
        kept = list(events)
        with self._lock:
            self._file.close()
            try:
                replace_text(self.path, "".join(_line(event) for event in kept))
                self._known = kept
            finally:
                self._file = self.path.open("ab", buffering=0)

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file. What was appended is on disk already."""
        with self._lock:
            self._file.close()


def read_events(session_folder: Path) -> list[Event]:
    """Return the events of a session's journal, to look at: nothing is mended, and another program may go on writing."""
    path = Path(session_folder) / JOURNAL_FILE
    if not path.is_file():
        return []
    lines = path.read_bytes().splitlines()
    return [event for line in lines if (event := _event(line)) is not None]


def _text(data: Any) -> str:
    return json.dumps(data, default=_plain, ensure_ascii=False, separators=(",", ":"))


def _line(event: Event) -> str:
    entry = {"time_s": round(event.time_s, 3), "kind": event.kind, "data": event.data}
    text = _text(entry).removesuffix("}")
    return f'{text}{_SUM_KEY}{_checksum(text.encode())}"}}\n'


def _checksum(text: bytes) -> str:
    return f"{zlib.crc32(text):08x}"


def _plain(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"a journal cannot hold {type(value).__name__}")


def _mended(path: Path) -> tuple[list[Event], int]:
    """Return the events of a file and the number of unreadable lines; cut off a torn end."""
    if not path.exists():
        return [], 0
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    torn = int(whole < len(content))
    if torn:
        with path.open("r+b") as file:
            file.truncate(whole)
            os.fsync(file.fileno())
    read = [_event(line) for line in content[:whole].splitlines() if line.strip()]
    known = [event for event in read if event is not None]
    return known, len(read) - len(known) + torn


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
