"""Opening: what can be shown comes before anything is fitted or counted; what is missing is said; a bundled recording is copied, the demo's
is tracked already, and plays."""

import threading

import numpy as np
from numpy.testing import assert_allclose

from handtrack import Session, evaluate, read_npz
from handtrack.session import bundled
from handtrack.session.layout import POSES_FILE
from handtrack.session.sources import video_audits
from handtrack.tracking.search import keypoint_start
from handtrack_app import protocol
from handtrack_app.engine import opening
from handtrack_app.engine.opening import nothing_observed
from handtrack_app.process.child import EnginePlan
from tests.app.cloudy_session import cloudy_session
from tests.app.desk import EngineInThreads, Listener, in_threads, shown, working
from tests.app.fake_run import FRAMES, fake_document
from tests.app.waiting import eventually
from tests.session.small_session import keypoints, make_session
from tests.session.test_times import FRAMES as ANNOUNCED
from tests.session.test_times import cut, with_video


def two_steps(monkeypatch, document):
    monkeypatch.setattr(opening, "opened", lambda folder: folder)
    monkeypatch.setattr(opening, "preview", fake_document)
    monkeypatch.setattr(opening, "document", document)


def test_pictures_are_shown_before_anything_is_fitted(tmp_path, monkeypatch):
    listener, before, held = Listener(), [], threading.Event()

    def opener(folder):
        before.extend(listener.seen)
        assert held.wait(600.0)
        return fake_document(folder)

    two_steps(monkeypatch, opener)
    worker = EngineInThreads(EnginePlan(tmp_path), listener.publish)
    worker.start()
    assert worker.wait_shown(600.0) is None
    worker.engine.show_frame(5)
    values = fake_document(tmp_path).start
    values[0] += 0.01
    worker.engine.set_pose(5, tuple(values.tolist()), 1)  # it shows at once, and is not lost
    listener.pose(1)
    held.set()
    assert worker.wait_opened(600.0) is None
    worker.stop()
    known = [type(one) for one in before]
    assert known.index(protocol.SessionSnapshot) < known.index(protocol.PoseSnapshot)
    assert known.index(protocol.PoseSnapshot) < known.index(protocol.PictureSnapshot)
    (strip,) = (one for one in before if isinstance(one, protocol.TimelineSnapshot))
    assert (strip.status < 0).all(), "nothing is tracked before the session is open"
    assert worker.document.frame == 5
    assert_allclose(worker.document.by_hand[5], values, atol=1e-9)


def test_a_failure_after_the_preview_is_told(tmp_path, monkeypatch):
    listener = Listener()

    def opener(folder):
        raise ValueError("no such thing")

    two_steps(monkeypatch, opener)
    worker = EngineInThreads(EnginePlan(tmp_path), listener.publish)
    worker.start()
    assert isinstance(worker.wait_opened(600.0), ValueError)
    listener.wait(protocol.ProgressSnapshot, lambda p: p.state == "failed")
    worker.stop()


def test_the_preview_lays_the_hand_on_the_first_pose_without_a_fit(tmp_path, monkeypatch):
    def fit(*_, **__):
        raise AssertionError("a fit")

    monkeypatch.setattr(keypoint_start, "solve", fit)
    folder = make_session(tmp_path)
    document = opening.preview(opening.opened(folder))
    model = document.model
    shown = model.keypoints21(model.bones(model.transform.solver_params(document.start)))
    assert np.linalg.norm(shown - keypoints(), axis=1).mean() < 0.03


def test_the_true_frames_follow_and_damage_is_told(tmp_path, monkeypatch):
    cut(with_video(tmp_path) / "cam0.avi")
    may_count, audited = threading.Event(), video_audits.VideoFile.audited

    def waiting(video):
        may_count.wait(600.0)
        return audited(video)

    monkeypatch.setattr(video_audits.VideoFile, "audited", waiting)
    worker, listener = working(tmp_path)
    assert listener.wait(protocol.TimelineSnapshot).stop == ANNOUNCED
    may_count.set()
    told = listener.told("can be decoded")
    assert f"{ANNOUNCED} frames" in told.text
    strip = listener.wait(protocol.TimelineSnapshot, lambda s: s.stop < ANNOUNCED)
    assert strip.start == 0
    eventually((tmp_path / "tracks" / "videos.json").is_file)
    worker.stop()


def test_images_alone_are_nothing_to_track_by_until_edges_count(tmp_path):
    path = cloudy_session(tmp_path) / "session.toml"
    path.write_text(path.read_text().partition("[clouds]")[0])
    run = opening.document(opening.opened(tmp_path)).run
    assert nothing_observed(run) and not nothing_observed(run.with_values({"edges.weight": 1.0}))


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
    places = first.model.joint_positions(first.model.bones(first.displayed))
    assert_allclose(places, track.joint_positions[20], atol=1e-6)
    (folder / POSES_FILE).unlink()
    assert bundled.demo_session() == folder and not (folder / POSES_FILE).exists()


def test_the_demo_plays_at_once_what_is_tracked(tmp_path):
    with shown(tmp_path, opener=fake_document, demo=True) as bench:
        eventually(lambda: bench.state.strip)
        assert not bench.state.playing, "nothing is tracked"
        bench.engine.track(0, FRAMES, 0, anew=True)
        eventually(lambda: (bench.state.strip.status >= 0).sum() == FRAMES)
    with shown(tmp_path, opener=fake_document, demo=True) as bench:
        eventually(lambda: bench.state.playing)
        assert not bench.worker.busy
    bench = in_threads(tmp_path, opener=fake_document, demo=True)
    bench.state.begin_edit()
    bench.start()
    eventually(lambda: bench.state.progress.state == "idle")
    bench.engine.show_frame(3)
    eventually(lambda: bench.stage.pose and bench.stage.pose.frame == 3, "all before is shown")
    assert not bench.state.playing, "whoever moved a finger meanwhile sees the finger"
    bench.stop()
