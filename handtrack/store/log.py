"""A log: a folder of segments, each written by one program once and never changed again.

Who opens a store to write gets a new generation (`lease`), and writes to segments of that number only. So no file ever has
two writers, whatever they believe of each other; nothing is cut, replaced or mended, and damage stays where it is.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from handtrack.errors import HandtrackError
from handtrack.files.atomic import sync_folder
from handtrack.store.record import Record, encoded, scan

_ENDING = ".log"


def segments(folder: Path) -> list[Path]:
    """Return the segments of a log, the oldest generation first."""
    found = (path for path in folder.glob(f"*{_ENDING}") if path.stem.isdecimal())
    return sorted(found, key=lambda path: int(path.stem))


def size_of(folder: Path) -> int:
    """Return how many bytes a log takes."""
    return sum(path.stat().st_size for path in segments(folder))


def read_log(
    folder: Path, damage: list[str], payloads: bool = True, mark: bytes = b""
) -> Iterator[Record]:
    """Yield the records of a log in order. A sentence for whatever is damaged or missing is added to `damage`."""
    for _, record in read_segments(folder, damage, payloads, mark):
        yield record


def read_at(path: Path, offset: int) -> Record:
    """Return the record at a place of a segment. Raises HandtrackError where none stands there any more."""
    with suppress(OSError), path.open("rb") as file:
        file.seek(offset)
        found = next(scan(file, []), None)
        if found is not None and found.offset == offset:
            return found
    raise HandtrackError(
        f"{path}: the record at byte {offset} was there when the session was opened and cannot be read any more. Is the "
        "disk damaged, or was the file replaced? Open the session again to see what is left."
    )


def read_segments(
    folder: Path, damage: list[str], payloads: bool = True, mark: bytes = b""
) -> Iterator[tuple[Path, Record]]:
    """Yield the records of a log, each with the segment that it stands in; see `read_log`."""
    for path in segments(folder):
        if path.is_symlink() or not path.is_file():
            damage.append(f"{path} is no ordinary file, so it was not read.")
            continue
        if mark and mark not in path.read_bytes():
            continue
        expected = 1
        with path.open("rb") as file:
            for found in scan(file, damage, payloads):
                missing, expected = found.seq - expected, found.seq + 1
                if missing > 0:
                    damage.append(
                        f"{path}: {missing} record(s) before number {found.seq} are lost."
                    )
                yield path, found


class LogWriter:
    """Appends to the segment of one generation. Safe from several threads."""

    def __init__(self, folder: Path, generation: int, check: Callable[[], None]) -> None:
        """check: raises HandtrackError when this program may not write any more; asked before every record."""
        self.path = folder / f"{generation:06d}{_ENDING}"
        self._check = check
        self._lock = threading.Lock()
        self._file: int | None = None
        self._seq = self._end = 0
        self._torn = self._unsynced = False

    def append(
        self, kind: str, data: dict[str, Any], payload: bytes = b"", durable: bool = True
    ) -> int:
        """Write a record whole, or raise HandtrackError and leave the log as it was.

        Return where it begins in the file.

        Parameters
        ----------
        durable
            On disk when this returns. Otherwise the operating system has it, which outlives this
            program; `sync` brings it to disk.
        """
        with self._lock:
            self._check()
            try:
                handle = self._opened()
                self._cut()
                block = encoded(Record(self._seq + 1, kind, data, payload))
                self._torn = True
                rest = memoryview(block)
                while rest:
                    rest = rest[os.write(handle, rest) :]
                if durable:
                    os.fsync(handle)
            except OSError as error:
                with suppress(OSError):
                    self._cut()  # tried again before the next record: till then it looks like a torn end
                raise self._failed(error) from None
            self._torn, begin = False, self._end
            self._seq, self._end = self._seq + 1, begin + len(block)
            self._unsynced = not durable
            return begin

    def sync(self) -> None:
        """Bring to disk what was appended without waiting for it. Raises HandtrackError."""
        with self._lock:
            if not self._unsynced or self._file is None:
                return
            try:
                os.fsync(self._file)
            except OSError as error:
                raise self._failed(error) from None
            self._unsynced = False

    def close(self) -> None:
        """Bring everything to disk and close the file."""
        try:
            self.sync()
        finally:
            with self._lock:
                if self._file is not None:
                    os.close(self._file)
                    self._file = None

    def _opened(self) -> int:
        """Return the open segment; it is made, and its name is on disk, before its first record."""
        if self._file is None:
            make_folders(self.path.parent)
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | getattr(os, "O_BINARY", 0)
            handle = os.open(self.path, flags, 0o666)
            try:
                sync_folder(self.path.parent)
            except OSError:
                os.close(handle)
                self.path.unlink()
                raise
            self._file = handle
        elif not os.path.samestat(os.fstat(self._file), os.stat(self.path)):
            raise OSError(None, "another program put a file in its place")
        return self._file

    def _cut(self) -> None:
        """Remove what a write that failed has left of a record that nobody was told is saved."""
        if self._torn and self._file is not None:
            os.ftruncate(self._file, self._end)
            self._torn = False

    def _failed(self, error: OSError) -> HandtrackError:
        return HandtrackError(
            f"{self.path}: a change could not be written ({error.strerror}), so it is not saved. Free some space on that "
            "disk, or bring the folder back, and try again; what was saved before is untouched."
        )


def make_folders(folder: Path) -> None:
    """Make a folder and those above it, each name on disk."""
    if not folder.is_dir():
        make_folders(folder.parent)
        folder.mkdir(exist_ok=True)
        sync_folder(folder.parent)
