"""The store: takes are kept, the current track is composed of them, and what happens to the disk is told."""

import errno
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.store.spans import Span
from handtrack.store.store import Store, WritableStore
from tests.store.made import about, add_take, same, step


@pytest.fixture
def folder(tmp_path: Path) -> Path:
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
    track = Store(folder).current_track()
    assert Store(folder).current() == (Span(1, 0, 5), Span(2, 5, 8), Span(1, 8, 10))
    assert track is not None
    assert track.frame.tolist() == list(range(10))
    for frame, number in ((4, first), (5, second), (7, second), (8, first)):
        (expected,) = Store(folder).take(number).results(range(frame, frame + 1))
        assert np.array_equal(track.at(frame).parameters, expected.parameters)


def test_a12_the_newest_is_told_by_its_number_and_not_by_its_time(folder):
    with WritableStore(folder, "a test") as store:
        store.make_current(store.restored(add_take(store, range(3), 1)))
    with WritableStore(folder, "a test") as store:
        store.make_current(store.restored(add_take(store, range(3), 2)))
    later = folder / "actions/000001.log"
    os.utime(later, (2e9, 2e9))
    assert Store(folder).current() == (Span(2, 0, 3),)


def test_pruning_is_for_takes_that_are_not_current(folder):
    with WritableStore(folder, "a test") as store:
        add_take(store, range(3))
        store.make_current(store.restored(add_take(store, range(3))))
        with pytest.raises(HandtrackError, match="take 2 is part of the current track"):
            store.prune(2)
        freed = store.prune(1)
        assert freed > 1000
        assert [take.number for take in store.takes()] == [2]
        with pytest.raises(HandtrackError, match=r"no take 1; its takes: 2\."):
            store.make_current(store.restored(1))
        assert add_take(store, range(3)) == 3, "a number is used once"
    assert not (folder / "takes/0001").exists()


def test_a7_a_write_that_fails_at_any_call_leaves_all_that_was_saved(folder, monkeypatch):
    """The n-th call to the disk fails, for every n, half of it written; the next try succeeds."""
    names = ("write", "fsync", "ftruncate", "mkdir")
    real = {name: getattr(os, name) for name in names}
    left = [0]

    def failing(name: str):
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


def test_a6_a_folder_that_is_gone_is_told_and_not_made_again(folder):
    """Fault C44."""
    store = WritableStore(folder, "a test")
    writer = store.begin(about())
    shutil.rmtree(folder)
    with pytest.raises(HandtrackError, match="the folder was moved or removed"):
        writer.add(step(np.random.default_rng(0), 0))
    store.close()
    assert not folder.exists()


def test_a2_a_file_that_is_put_in_the_place_of_ours_is_noticed(folder):
    with WritableStore(folder, "a test") as store:
        writer = store.begin(about())
        path = folder / "takes/0001/000001.log"
        copy = path.with_suffix(".copy")
        shutil.copyfile(path, copy)
        copy.replace(path)
        with pytest.raises(HandtrackError, match="another program put a file in its place"):
            writer.add(step(np.random.default_rng(0), 0))


def test_a13_a_thousand_flipped_bits_none_is_accepted_silently(folder):
    with WritableStore(folder, "a test") as store:
        store.make_current(store.restored(add_take(store, range(2))))
    before = {frame.frame: frame for frame in Store(folder).take(1).results()}
    files = [path for path in folder.rglob("*") if path.is_file()]
    contents = [path.read_bytes() for path in files]
    rng = np.random.default_rng(1)
    for _ in range(1000):
        which = int(rng.integers(len(files)))
        damaged = bytearray(contents[which])
        damaged[rng.integers(len(damaged))] ^= 1 << int(rng.integers(8))
        files[which].write_bytes(damaged)
        store = Store(folder)
        assert len(store.damage()) >= 1
        assert store.current() in ((), (Span(1, 0, 2),))
        assert all(same(before[r.frame], r) for r in store.take(1).results())
        files[which].write_bytes(contents[which])
