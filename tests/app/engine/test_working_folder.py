"""Whoever opens a bundled recording works on a copy; the demo's is tracked already, and plays."""

import numpy as np
import pytest

from handtrack import Session, evaluate, read_npz
from handtrack.session import bundled
from handtrack.session.bundled import working_folder
from handtrack.session.layout import POSES_FILE
from handtrack_app.engine import opening
from tests.app.desk import in_threads, shown
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


def test_the_demo_is_tracked_when_it_is_opened_and_stays_as_its_user_left_it(monkeypatch, tmp_path):
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    folder = bundled.demo_session()
    assert tmp_path in folder.parents
    track, session = read_npz(folder / POSES_FILE), Session.open(folder)
    assert track.frame.tolist() == list(session.frame_range)
    assert session.truth is not None
    assert evaluate(track, session.truth)["mpjpe_median_mm"] < 6.0
    first = opening.preview(session)  # before anything is fitted
    first.show(20)
    places = first.model.joint_positions(first.model.bones(first.seen))
    np.testing.assert_allclose(places, track.joint_positions[20], atol=1e-6)
    (folder / POSES_FILE).unlink()
    assert bundled.demo_session() == folder and not (folder / POSES_FILE).exists()


def test_the_demo_plays_at_once_what_is_tracked(tmp_path):
    with shown(tmp_path, opener=fake_document, demo=True) as bench:
        eventually(lambda: bench.layout.timeline.strip, "it is shown")
        assert not bench.state.playing, "nothing is tracked"
        bench.engine.track(0, FRAMES, 0, anew=True)
        eventually(
            lambda: (bench.layout.timeline.strip.status >= 0).sum() == FRAMES, "it is tracked"
        )
    with shown(tmp_path, opener=fake_document, demo=True) as bench:
        eventually(lambda: bench.state.playing, "it plays at once")
        assert not bench.worker.busy
    bench = in_threads(tmp_path, opener=fake_document, demo=True)
    bench.state.begin_edit()
    bench.start()
    eventually(lambda: bench.layout.progress.state == "idle", "it is open")
    bench.engine.show_frame(3)
    eventually(lambda: bench.stage.pose and bench.stage.pose.frame == 3, "all before is shown")
    assert not bench.state.playing, "whoever moved a finger meanwhile sees the finger"
    bench.stop()
