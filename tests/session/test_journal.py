"""The journal: what was accepted is on disk, whatever happens next."""

from __future__ import annotations

import errno
import multiprocessing
import os
import threading

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.session import journal as journal_module
from handtrack.session.journal import Journal


@pytest.fixture
def open_journal(tmp_path):
    """Open the journal of tmp_path, as often as asked; all are closed in the end."""
    opened = []

    def open_one() -> Journal:
        opened.append(Journal.open(tmp_path))
        return opened[-1]

    yield open_one
    for journal in opened:
        journal.close()


def kinds(journal: Journal) -> list[str]:
    return [event.kind for event in journal.events()]


def test_events_come_back_in_order(open_journal, tmp_path):
    journal = open_journal()
    journal.append("pose", {"frame": 3, "values": np.array([0.1, np.inf]), "count": np.int64(2)})
    journal.append("setting", {"name": "silhouettes.weight", "text": "größer\nals"})
    again = open_journal()
    assert kinds(again) == ["pose", "setting"]
    assert again.events()[0].data == {"frame": 3, "values": [0.1, np.inf], "count": 2}
    assert again.events()[1].data["text"] == "größer\nals"
    assert again.events()[0].time_s > 1e9
    assert again.damaged == 0
    assert journal.events()[0].data == again.events()[0].data
    assert (tmp_path / "tracks" / "journal.jsonl").read_text(encoding="utf-8").count("\n") == 2


def test_numbers_come_back_exactly(open_journal, rng):
    values = rng.normal(size=50)
    open_journal().append("pose", {"values": values})
    np.testing.assert_array_equal(open_journal().events()[0].data["values"], values)


@pytest.mark.parametrize("cut", [1, 7, 30])
def test_a_torn_last_line_is_dropped_and_writing_goes_on(open_journal, cut):
    journal = open_journal()
    for k in range(3):
        journal.append("tracked", {"frame": k})
    content = journal.path.read_bytes()
    journal.path.write_bytes(content[:-cut])
    mended = open_journal()
    assert [event.data["frame"] for event in mended.events()] == [0, 1]
    assert mended.damaged == 1
    mended.append("tracked", {"frame": 9})
    assert [event.data["frame"] for event in open_journal().events()] == [0, 1, 9]
    assert open_journal().damaged == 0


def test_a_damaged_line_costs_only_itself(open_journal):
    journal = open_journal()
    for k in range(3):
        journal.append("tracked", {"frame": k})
    lines = journal.path.read_bytes().splitlines(keepends=True)
    journal.path.write_bytes(lines[0] + b"\x00\x00\xff{\n[1]\n" + lines[2])
    mended = open_journal()
    assert [event.data["frame"] for event in mended.events()] == [0, 2]
    assert mended.damaged == 2


def test_a13_no_flipped_bit_of_a_line_is_taken_for_data(open_journal):
    journal = open_journal()
    journal.append("pose", {"frame": 6, "parameters": {"index_mcp_flex": 1.25}, "found": False})
    content = journal.path.read_bytes()
    whole = [event.data for event in journal.events()]
    for bit in range(8 * len(content)):
        flipped = bytearray(content)
        flipped[bit // 8] ^= 1 << bit % 8
        lines = bytes(flipped).splitlines()
        assert all(journal_module._event(line) is None for line in lines), flipped
    journal.path.write_bytes(content.replace(b"1.25", b"9.25") + content)
    again = open_journal()
    assert [event.data for event in again.events()] == whole
    assert again.damaged == 1


def test_lines_of_earlier_versions_are_read(open_journal, tmp_path):
    (tmp_path / "tracks").mkdir()
    line = '{"time_s":1.5,"kind":"pose","data":{"frame":3}}\n'
    (tmp_path / "tracks/journal.jsonl").write_text(line)
    assert open_journal().events()[0].data == {"frame": 3}


def _append_and_die(folder) -> None:
    Journal.open(folder).append("pose", {"frame": 5})
    os._exit(1)


def test_an_event_outlives_a_crash_right_after_it(open_journal, tmp_path):
    process = multiprocessing.get_context("spawn").Process(target=_append_and_die, args=(tmp_path,))
    process.start()
    process.join()
    assert open_journal().events()[0].data == {"frame": 5}


def test_threads_do_not_mix_their_lines(open_journal):
    journal = open_journal()

    def work(number: int) -> None:
        for k in range(20):
            journal.append("tracked", {"thread": number, "k": k, "filler": "x" * 500})

    threads = [threading.Thread(target=work, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    found = open_journal()
    assert found.damaged == 0
    assert len(found.events()) == 80


def test_a_full_disk_is_said_and_half_a_line_is_taken_back(open_journal, monkeypatch):
    journal = open_journal()
    journal.append("pose", {"frame": 1})
    write, calls = os.write, []

    def full(handle: int, data) -> int:
        if calls:
            raise OSError(errno.ENOSPC, "No space left on device")
        calls.append(1)
        return write(handle, data[:10])

    monkeypatch.setattr(journal_module.os, "write", full)
    with pytest.raises(HandtrackError, match="could not be written .No space left on device."):
        journal.append("pose", {"frame": 2})
    monkeypatch.undo()
    journal.append("pose", {"frame": 3})
    again = open_journal()
    assert again.damaged == 0
    assert [event.data["frame"] for event in again.events()] == [1, 3]


def test_a_journal_can_be_shortened(open_journal):
    journal = open_journal()
    journal.append_all([("pose", {"frame": k}) for k in range(10)])
    journal.replace(journal.events()[-2:])
    journal.append("pose", {"frame": 10})
    assert [event.data["frame"] for event in journal.events()] == [8, 9, 10]
    assert [event.data["frame"] for event in open_journal().events()] == [8, 9, 10]


def test_a_folder_that_is_not_there_is_the_users_error(tmp_path):
    with pytest.raises(HandtrackError, match="the journal cannot be written"):
        Journal.open(tmp_path / "none")


def test_what_json_cannot_hold_is_our_mistake(open_journal):
    journal = open_journal()
    with pytest.raises(TypeError, match="a journal cannot hold set"):
        journal.append("pose", {"frames": {1, 2}})
    assert journal.events() == []
