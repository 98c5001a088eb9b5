"""The journal of earlier versions: what is whole is read, what is damaged is passed over."""

from __future__ import annotations

import json
import zlib
from pathlib import Path

from handtrack.session.journal import read_events


def line(kind: str, checked: bool = True, **data: object) -> bytes:
    text = json.dumps({"time_s": 1.5, "kind": kind, "data": data}, separators=(",", ":"))[:-1]
    if not checked:
        return f"{text}}}\n".encode()
    return f'{text},"crc":"{zlib.crc32(text.encode()):08x}"}}\n'.encode()


def written(folder: Path, *lines: bytes) -> Path:
    (folder / "tracks").mkdir(exist_ok=True)
    path = folder / "tracks/journal.jsonl"
    path.write_bytes(b"".join(lines))
    return path


def test_lines_are_read_in_order_with_and_without_a_checksum(tmp_path: Path) -> None:
    assert read_events(tmp_path) == []
    written(tmp_path, line("pose", frame=3), line("setting", checked=False, name="größer"))
    events = read_events(tmp_path)
    assert [(e.kind, e.data, e.time_s) for e in events] == [
        ("pose", {"frame": 3}, 1.5), ("setting", {"name": "größer"}, 1.5),
    ]  # fmt: skip


def test_a_damaged_line_costs_only_itself(tmp_path: Path) -> None:
    flipped = line("pose", frame=4).replace(b'"frame":4', b'"frame":5')
    torn = line("pose", frame=6)[:-9]
    path = written(tmp_path, line("pose", frame=3), flipped, b"\x00\xff{\n[1]\n", line("end"), torn)
    before = path.read_bytes()
    assert [e.kind for e in read_events(tmp_path)] == ["pose", "end"]
    assert path.read_bytes() == before
