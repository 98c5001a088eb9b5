"""Records, one after another in a file: a line of JSON with its checksum, then the bytes of its arrays, if it has any.

    5d8acb20 {"seq":2,"kind":"file","data":{"digest":"5be36c54"}}
    91b7e003 {"seq":3,"kind":"step","payload":[12408,1830214774],"data":{"frame":0, …}}
    … 12408 bytes …

Lines can be read by people and by any program. Nothing is believed whose CRC-32 is not right, so no single flipped bit
ever is; after damage the next whole record is looked for, and its number says how many are missing.
"""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, BinaryIO

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
