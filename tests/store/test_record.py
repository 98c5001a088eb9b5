"""Records: read as they were written; whatever is not is told."""

import io
from dataclasses import replace

import numpy as np
import pytest

from handtrack.store.record import Gap, Record, encoded, scan

RECORDS = [
    Record(1, "current", {"spans": [[1, 0, 100]], "name": "Größe\n"}),
    Record(2, "step", {"frame": 0}, bytes(range(256)) + b'\n00000000 {"seq":9,"kind":"x"}\n'),
    Record(3, "step", {"frame": 1, "energy": float("nan")}, b"\n" * 300),
    Record(4, "end"),
]
FILE = b"".join(map(encoded, RECORDS))


def read(content: bytes, payloads: bool = True) -> list[Record | Gap]:
    return list(scan(io.BytesIO(content), payloads))


def same(one: Record | Gap, other: Record | Gap) -> bool:
    """Whether they hold the same, wherever they stand."""
    unplaced = [replace(r, offset=0) if isinstance(r, Record) else r for r in (one, other)]
    return repr(unplaced[0]) == repr(unplaced[1])


def test_what_is_written_is_read():
    assert all(map(same, read(FILE), RECORDS))
    assert [r.payload for r in read(FILE, payloads=False) if isinstance(r, Record)] == [b""] * 4


def test_a13_no_flipped_bit_is_taken_for_data():
    """Bits of a file, one by one: the record is gone and the damage told; all others are as they were."""
    last = len(FILE) - len(encoded(RECORDS[-1]))
    for bit in range(0, 8 * len(FILE), 3):
        damaged = bytearray(FILE)
        damaged[bit // 8] ^= 1 << (bit % 8)
        found = read(bytes(damaged))
        gaps = [entry for entry in found if isinstance(entry, Gap)]
        assert {gap.at_end for gap in gaps} == {bit // 8 >= last}
        kept = [entry for entry in found if isinstance(entry, Record)]
        assert len(kept) == 3
        assert all(any(same(entry, record) for record in RECORDS) for entry in kept)


@pytest.mark.parametrize("length", range(0, len(FILE), 7))
def test_a_cut_file_loses_its_end_alone(length):
    ends = np.cumsum([len(encoded(record)) for record in RECORDS])
    whole = int((ends <= length).sum())
    found = read(FILE[:length])
    assert all(map(same, found[:whole], RECORDS))
    rest = length - int(ends[whole - 1] if whole else 0)
    gaps = found[whole:]
    assert sum(gap.length for gap in gaps if isinstance(gap, Gap)) == rest
    assert all(isinstance(gap, Gap) for gap in gaps)
    assert not gaps or (isinstance(gaps[-1], Gap) and gaps[-1].at_end)
