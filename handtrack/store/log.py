"""A log: a folder of segments, each written by one program once and never changed again.

Who opens a store to write gets a new generation (`lease`), and writes to segments of that number only. So no file ever has
two writers, whatever they believe of each other; nothing is cut, replaced or mended, and damage stays where it is.
"""

from __future__ import annotations

import json
import os
import re
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

from handtrack.errors import HandtrackError
from handtrack.files.atomic import sync_folder

_LONGEST_LINE = 1 << 20
_LARGEST_PAYLOAD = 1 << 28
_BEGIN = re.compile(rb'[0-9a-f]{8} \{"seq":')
_CHUNK = 1 << 16


@dataclass(frozen=True, eq=False)
class Record:
    """What was written at one time."""

    seq: int
    """its number in the file, from 1"""
    kind: str
    data: dict[str, Any] = field(default_factory=dict)
    payload: bytes = b""
    """empty too where payloads were passed over"""
    offset: int = 0
    """where it begins in the file that it was read from"""


def encoded(record: Record) -> bytes:
    """Return a record as it stands in a file."""
    line: dict[str, object] = {"seq": record.seq, "kind": record.kind}
    if record.payload:
        line["payload"] = [len(record.payload), zlib.crc32(record.payload)]
    line["data"] = record.data
    text = json.dumps(line, ensure_ascii=False, separators=(",", ":")).encode()
    end = record.payload + b"\n" if record.payload else b""
    return b"%08x %b\n%b" % (zlib.crc32(text), text, end)


def scan(file: BinaryIO, damage: list[str], payloads: bool = True) -> Iterator[Record]:
    """Yield the records of a file from its present place. Takes memory for one of them.

    Parameters
    ----------
    damage
        Gets a sentence for each stretch of bytes that holds no whole record. One at the end may be a last record torn by a crash.
    payloads
        Whether the bytes of arrays are read and checked; else they are passed over, which is quick.
    """
    while True:
        begin = file.tell()
        line = file.readline(_LONGEST_LINE)
        if not line:
            return
        found = _record(begin, line, file, payloads)
        if found is not None:
            yield found
            continue
        after = _next_record(file, begin)
        file.seek(after)
        why = "" if file.read(1) else ": the last one was not written to its end, or was damaged"
        file.seek(after)
        where = f"{after - begin} bytes at {begin} hold no whole record"
        damage.append(f"{file.name}: {where}{why}. They are kept, and not used.")


def _record(begin: int, line: bytes, file: BinaryIO, payloads: bool) -> Record | None:
    """Return the record that begins with a line at `begin`, None when there is none. Reads to the record's end."""
    crc, space, text = line[:8], line[8:9], line[9:-1]
    if space != b" " or line[-1:] != b"\n" or crc != b"%08x" % zlib.crc32(text):
        return None
    try:
        read = json.loads(text.decode())
        size, sum_ = read.get("payload", (0, 0))
        record = Record(int(read["seq"]), str(read["kind"]), dict(read["data"]), offset=begin)
    except (ValueError, KeyError, TypeError, RecursionError):
        return None  # another program's line, with a right checksum
    if not size:
        return record
    if not 0 < size <= _LARGEST_PAYLOAD:
        return None
    if payloads:
        payload = file.read(size)
        if len(payload) < size or zlib.crc32(payload) != sum_:
            return None
        record = replace(record, payload=payload)
    else:
        file.seek(size, 1)
    return record if file.read(1) == b"\n" else None


def _next_record(file: BinaryIO, begin: int) -> int:
    """Return where something next looks like a record's beginning, after `begin`; the file's end if none does."""
    file.seek(begin + 1)
    place, held = begin + 1, b""
    while chunk := file.read(_CHUNK):
        held += chunk
        match = _BEGIN.search(held)
        if match is not None:
            return place + match.start()
        kept = held[-32:]  # a beginning may lie across two chunks
        place, held = place + len(held) - len(kept), kept
    return file.tell()


# ---- Records, appended to a segment and read from it


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
