"""Whoever opens a bundled recording works on a copy; and the demo tracks that by itself."""

import pytest

from handtrack.session import bundled
from handtrack.session.bundled import working_folder
from tests.app.desk import shown
from tests.app.fake_run import FRAMES, fake_document
from tests.app.waiting import eventually


@pytest.fixture
def shelf(tmp_path, monkeypatch):
    folder = tmp_path / "checkout"
    (folder / "fist" / "tracks").mkdir(parents=True)
    (folder / "fist" / "session.toml").write_text("[session]")
    (folder / "fist" / "tracks" / "journal.jsonl").write_text("old")
    monkeypatch.setattr(bundled, "_CHECKOUT", folder)
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    return folder


def test_a_recording_of_a_checkout_is_copied_without_what_was_made_of_it(shelf, tmp_path):
    copy = working_folder(shelf / "fist")
    assert copy.parent == tmp_path / "home" / "sessions" and copy.name.startswith("fist-")
    assert [p.name for p in copy.iterdir()] == ["session.toml"]
    (copy / "init.json").write_text("mine")
    assert working_folder(shelf / "fist") == copy and (copy / "init.json").read_text() == "mine"


def test_the_demo_tracks_itself_then_plays_and_plays_at_once_the_next_time(tmp_path):
    with shown(tmp_path, opener=lambda f: fake_document(f, step_s=0.01), demo=True) as bench:
        eventually(lambda: bench.state.playing, "it plays")
        timeline = bench.layout.timeline
        eventually(lambda: (timeline.strip.status >= 0).sum() == FRAMES, "what was tracked")
    with shown(tmp_path, opener=fake_document, demo=True) as bench:
        eventually(lambda: bench.state.playing, "it plays at once")
        assert not bench.worker.busy
