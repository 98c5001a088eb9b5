"""The store: takes, records, history and the lease."""

import errno
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from handtrack import HandtrackError
from handtrack.store import lease as lease_file
from handtrack.store.history import Action, Change, History
from handtrack.store.lease import Lease, LeaseTaken, holder_of
from handtrack.store.log import Record, encoded, scan
from handtrack.store.store import Span, Store, WritableStore, resolved
from tests.conftest import refused
from tests.store.made import about, add_take, files_of, same, step


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "tracks"


def test_a_take_is_read_as_it_was_written(folder, rng):
    steps = [step(rng, frame, hypotheses=frame % 3) for frame in (2, 3, 4, 1, 0)]
    with WritableStore(folder, "a test") as store:
        writer = store.begin(about())
        for one in steps:
            writer.add(one)
        writer.replace(steps[0].result)
        writer.finish()
    (take,) = Store(folder).takes()
    assert same(tuple(take.steps()), tuple(steps))
    assert take.frames == (0, 1, 2, 3, 4)
    assert [result.frame for result in take.results(range(1, 3))] == [1, 2]
    assert take.is_finished
    assert take.about == about()
    assert not Store(folder).damage()


def test_takes_are_never_overwritten_and_the_track_is_composed_of_them(folder):
    with WritableStore(folder, "a test") as store:
        first, second = add_take(store, range(10), 1), add_take(store, range(4, 8), 2)
        store.make_current(store.restored(first))
        store.make_current(store.restored(second, range(5, 100)))
    track = Store(folder).track_of(Store(folder).current())
    assert Store(folder).current() == (Span(1, 0, 5), Span(2, 5, 8), Span(1, 8, 10))
    assert resolved((Span(1, 0, 3), Span(1, 3, 6)), lambda _: range(6)) == (Span(1, 0, 6),)
    assert track.frame.tolist() == list(range(10))
    for frame, number in ((4, first), (5, second), (7, second), (8, first)):
        (expected,) = Store(folder).take(number).results(range(frame, frame + 1))
        assert np.array_equal(track.at(frame).parameters, expected.parameters)


def test_a12_the_newest_is_told_by_its_number_and_not_by_its_time(folder):
    for seed in (1, 2):
        with WritableStore(folder, "a test") as store:
            store.make_current(store.restored(add_take(store, range(3), seed)))
    later = folder / "actions/000001.log"
    os.utime(later, (2e9, 2e9))
    assert Store(folder).current() == (Span(2, 0, 3),)


def test_the_number_of_a_take_that_was_pruned_is_not_used_again(folder):
    """That it is gone and what may be pruned: tests/app/commands/test_takes.py."""
    with WritableStore(folder, "a test") as store:
        assert store.prune(add_take(store, range(3))) > 1000
        assert add_take(store, range(3)) == 2
    assert not (folder / "takes/0001").exists()


def test_a7_a_write_that_fails_at_any_call_leaves_all_that_was_saved(folder, monkeypatch):
    """The n-th call to the disk fails, for every n, half of it written; the next try succeeds."""
    names = ("write", "fsync", "ftruncate", "mkdir")
    real = {name: getattr(os, name) for name in names}
    left = [0]

    def failing(name):
        def call(*args, **options):
            left[0] -= 1
            if left[0] == 0:
                if name == "write":
                    real["write"](args[0], bytes(args[1])[: len(args[1]) // 2])
                raise OSError(errno.ENOSPC, "No space left on device")
            return real[name](*args, **options)

        return call

    for name in names:
        monkeypatch.setattr(os, name, failing(name))
    monkeypatch.setattr("handtrack.store.store._SYNC_S", 60.0)
    for n in range(1, 200):
        shutil.rmtree(folder, ignore_errors=True)
        left[0] = 0
        with WritableStore(folder, "a test") as store:
            writer = store.begin(about())
            rng = np.random.default_rng(0)
            saved, failed = [], 0
            left[0] = n
            for frame in range(3):
                one = step(rng, frame)
                for _ in range(2):
                    try:
                        writer.add(one)
                        saved.append(one)
                        store.make_current([Span(1, 0, frame + 1)])
                        break
                    except HandtrackError as error:
                        failed += "No space left on device" in str(error)
            over = left[0] > 0
            left[0] = 0
        assert failed == (not over)
        assert {s.result.frame for s in Store(folder).take(1).steps()} == {0, 1, 2}
        assert Store(folder).current() == (Span(1, 0, 3),)
        assert not Store(folder).damage()
        if over:
            return
    raise AssertionError("there was no end of calls")


def test_a2_a6_a_file_in_the_place_of_ours_is_noticed_and_a_folder_that_is_gone_not_made_again(
    folder,
):
    """Fault C44."""
    store, frame = WritableStore(folder, "a test"), step(np.random.default_rng(0), 0)
    writer, path = store.begin(about()), folder / "takes/0001/000001.log"
    shutil.copyfile(path, path.with_suffix(".copy")).replace(path)
    refused("another program", writer.add, frame)
    shutil.rmtree(folder)
    refused("moved", writer.add, frame)
    store.close()
    assert not folder.exists()


def test_a13_of_hundreds_of_flipped_bits_none_is_accepted_silently(folder):
    with WritableStore(folder, "a test") as store:
        store.make_current(store.restored(add_take(store, range(2))))
    before = {frame.frame: frame for frame in Store(folder).take(1).results()}
    files = [path for path in folder.rglob("*") if path.is_file()]
    contents = [path.read_bytes() for path in files]
    rng = np.random.default_rng(1)
    for _ in range(300):
        which = int(rng.integers(len(files)))
        damaged = bytearray(contents[which])
        damaged[rng.integers(len(damaged))] ^= 1 << int(rng.integers(8))
        files[which].write_bytes(damaged)
        store = Store(folder)
        assert len(store.damage()) >= 1
        assert store.current() in ((), (Span(1, 0, 2),))
        assert all(same(before[r.frame], r) for r in store.take(1).results())
        files[which].write_bytes(contents[which])


RECORDS = [
    Record(1, "current", {"spans": [[1, 0, 100]], "name": "Größe\n"}),
    Record(2, "step", {"frame": 0}, bytes(range(256)) + b'\n00000000 {"seq":9,"kind":"x"}\n'),
    Record(3, "step", {"frame": 1, "energy": float("nan")}, b"\n" * 300),
    Record(4, "end"),
]
FILE = b"".join(map(encoded, RECORDS))


def same_record(one, other):
    """Whether they hold the same, wherever they stand."""
    return repr(replace(one, offset=other.offset)) == repr(other)


@pytest.mark.parametrize("length", [*range(0, len(FILE), 7), len(FILE)])
def test_a_cut_file_loses_its_end_alone(length, tmp_path):
    ends = np.cumsum([len(encoded(record)) for record in RECORDS])
    whole, damage = int((ends <= length).sum()), []
    path = tmp_path / "cut.log"
    path.write_bytes(FILE[:length])
    with path.open("rb") as file:
        found = list(scan(file, damage))
    assert len(found) == whole
    assert all(map(same_record, found, RECORDS))
    rest = length - int(ends[whole - 1] if whole else 0)
    lost = [int(re.search(r": (\d+) bytes at", text)[1]) for text in damage]
    assert sum(lost) == rest
    assert not damage or "the last one" in damage[-1]


def do(history, key, after, joins=False):
    change = Change(key, history.state.get(key), after)
    action = history.next(f"{key} to {after}", [change], "do", joins)
    history.take(action)
    return action


def travel(history, action):
    history.take(action)
    return action.words


def test_undo_and_redo_go_along_the_steps():
    history = History()
    actions = [do(history, "a", value) for value in (1, 2, 3)]
    actions.append(history.undoing())
    assert travel(history, actions[-1]) == "a to 3"
    assert History.of(Action.of(action.content) for action in actions) == history, "read again"
    assert travel(history, history.undoing()) == "a to 2"
    assert history.state == {"a": 1}
    assert travel(history, history.redoing()) == "a to 2"
    do(history, "b", 1)
    assert history.redoing() is None, "a new step drops what was undone"
    for _ in range(3):
        travel(history, history.undoing())
    assert history.undoing() is None and history.state == {}
    do(history, "a", 1)  # a drag is one step back to where it began
    for value in (2, 3, 4):
        do(history, "a", value, joins=value > 2)
    travel(history, history.undoing())
    assert history.state == {"a": 1}
    travel(history, history.redoing())
    assert history.state == {"a": 4}


def test_a2_a_second_writer_is_told_who_writes_and_may_read_or_take_over_and_nothing_is_lost(
    tmp_path,
):
    first, rng = WritableStore(tmp_path, "the first"), np.random.default_rng(0)
    begun = first.begin(about())
    begun.add(step(rng, 0))
    with pytest.raises(LeaseTaken) as told:
        WritableStore(tmp_path, "the second")
    assert f"`the first` (process {os.getpid()}" in str(told.value)
    assert Store(tmp_path).takes()[0].frames == (0,)
    assert first.lease.holder == holder_of(tmp_path)
    with WritableStore(tmp_path, "the second", take_over=True) as second:
        assert second.lease.generation == 2
        refused("`the second`", begun.add, step(rng, 1))
        second.go_on(second.take(1)).add(step(rng, 1))
    first.close()
    assert holder_of(tmp_path) is None
    assert Store(tmp_path).take(1).frames == (0, 1)
    assert files_of(tmp_path) == ["takes/0001/000001.log", "takes/0001/000002.log"]
    assert not Store(tmp_path).damage()


def test_a_lease_of_a_program_that_was_killed_is_stale_and_a_torn_one_is_no_reason_to_write(
    tmp_path,
):
    code = "import sys,os; from handtrack.store.lease import Lease; from pathlib import Path; " \
        "Lease.acquire(Path(sys.argv[1]), 'killed'); os._exit(9)"  # fmt: skip
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False)
    assert files_of(tmp_path) == ["lease-000001.json"]
    assert holder_of(tmp_path) is None
    with WritableStore(tmp_path, "the next"):
        assert files_of(tmp_path) == ["lease-000002.json"]
    tmp_path.mkdir()  # it was empty
    (tmp_path / "lease-000004.json").write_text('{"generation": 4, "pro')
    with pytest.raises(LeaseTaken, match="an unknown program"):
        WritableStore(tmp_path, "here")
    os.utime(tmp_path / "lease-000004.json", (0, 0))  # whoever wrote that was killed at it
    with WritableStore(tmp_path, "here") as store:
        assert store.lease.generation == 5


def test_of_two_that_find_a_stale_lease_one_gets_it(tmp_path, monkeypatch):
    really, others = lease_file._newest, []

    def newest(folder):
        found = really(folder)
        if not others:
            others.append(None)
            others[0] = Lease.acquire(folder, "the quicker")
        return found

    monkeypatch.setattr(lease_file, "_newest", newest)
    with pytest.raises(LeaseTaken, match="`the quicker`"):
        Lease.acquire(tmp_path, "the slower")
    others[0].release()
