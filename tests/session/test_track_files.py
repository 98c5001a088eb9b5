"""Tracks that lie there as files become takes once; nothing of them is lost."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from handtrack.session.formats.tables import read_npz, write_npz
from handtrack.session.takes.track_files import import_track
from handtrack.store.spans import Span
from handtrack.store.store import Store, WritableStore
from tests.sample_track import sample_track


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "tracks").mkdir()
    return tmp_path


def imported(folder: Path) -> str:
    with WritableStore(folder / "tracks", "a test") as store:
        return import_track(store, folder)


def test_a_track_file_is_a_take_from_now_on(folder, rng):
    poses = folder / "tracks/poses.npz"
    write_npz(poses, sample_track(rng, range(3, 9)))
    before, bytes_ = read_npz(poses), poses.read_bytes()
    assert imported(folder) == f"{poses} is kept as take 1."
    assert not imported(folder)
    store = Store(folder / "tracks")
    assert store.current() == (Span(1, 3, 9),)
    track = store.current_track()
    assert track is not None
    for field in fields(track):
        assert np.array_equal(getattr(track, field.name), getattr(before, field.name)), field.name
    again = folder / "again.npz"
    write_npz(again, track)
    assert again.read_bytes() == poses.read_bytes() == bytes_


def test_a12_whatever_was_put_there_is_kept_whenever_it_was_written(folder, rng):
    for _ in range(2):
        write_npz(folder / "tracks/poses.npz", sample_track(rng))
        assert imported(folder)
    takes = Store(folder / "tracks").takes()
    assert [take.about.by for take in takes] == ["tracks/poses.npz", "tracks/poses.npz"]
    assert Store(folder / "tracks").current() == (Span(1, 0, 5),), (
        "what is current is the user's choice"
    )
