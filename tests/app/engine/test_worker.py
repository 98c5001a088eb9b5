"""The worker: latest wins, cancel at once, mistakes in words; a size fitted first or later; keyframes stay, also forgotten ones;
edits reach the disk however they follow one another and whatever failed in between."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from handtrack import HandScale, HandtrackError, load_model
from handtrack.session.session_state import key_of
from handtrack.store.store import Store
from handtrack.tracking.frame.reason import Reason
from handtrack_app import protocol
from handtrack_app.engine import open_session, persistence
from handtrack_app.engine.open_session import COMMANDS
from handtrack_app.engine.service import BackgroundJob
from handtrack_app.protocol import Call, Mailbox
from tests.app.desk import a_desk, pose_with
from tests.app.fake_run import FRAMES, FakeRun
from tests.app.waiting import eventually


def test_newest_pose_and_frame_win_and_nothing_else_is_dropped():
    box = Mailbox(lambda c: c.key)
    put = lambda name, *given: box.put(Call.of(COMMANDS, name, given, {}))  # noqa: E731
    for version in range(5):
        for tag in ("index", "ring"):  # moved by another slider it is another step
            put("set_pose", 0, (), version, tag)
        put("show_frame", version)
        put("export", "csv", version)
    kept = [box.take(0.0) for _ in range(len(box))]
    names = [(c.name, c.arguments.get("version")) for c in kept if c.name != "export"]
    assert names[-3:] == [("set_pose", 4), ("set_pose", 4), ("show_frame", None)]
    assert sum(c.name == "export" for c in kept) == 5


def test_a_pose_is_moved_into_its_limits(worker, listener):
    worker.engine.set_pose(
        3, pose_with(listener, index_mcp_flex=50.0, root_tx=1e30, root_ty=float("nan")), 1
    )
    pose = listener.pose(1)
    session = listener.wait(protocol.SessionSnapshot)
    index = session.parameter_names.index("index_mcp_flex")
    assert pose.values[index] == pytest.approx(session.interval[index, 1])
    assert np.isfinite(pose.centre).all()
    assert pose.origin == "set"


def track_all(worker, listener, first=3, **how):
    worker.engine.track(0, FRAMES, first, **how)
    listener.told("Tracking finished")


@pytest.fixture
def halted(tmp_path):
    """A worker that tracks and stands at frame 5 until the event is set."""
    go_on = threading.Event()
    for worker, listener in a_desk(tmp_path, stuck=lambda f: f == 5 and not go_on.is_set()):
        worker.engine.track(0, FRAMES, 3)
        listener.wait(protocol.ProgressSnapshot, lambda p: p.done == 2)
        yield worker, listener, go_on


def test_steps_that_may_compile_foretell_no_time_left():
    job = BackgroundJob("refining", lambda _: None, lambda *_: None, None, False)
    known = [job.progress(step / 40) or job.eta_s() > 0 for step in range(1, 7)]
    assert known == [False] * 4 + [True] * 2


def test_a14_pause_holds_with_every_frame_on_disk_and_goes_on(halted, tmp_path):
    (worker, listener, go_on), store = halted, Store(tmp_path / "tracks")
    worker.engine.pause(True)
    listener.wait(protocol.ProgressSnapshot, lambda p: p.state == "paused")
    eventually(lambda: store.frames_of(1) == (3, 4))
    go_on.set()
    time.sleep(0.3)
    assert sorted(worker.document.results) == [3, 4]
    worker.engine.pause(False)
    listener.told("Tracking finished")


def test_a_mistake_of_ours_ends_the_job_and_not_the_worker(tmp_path):
    for worker, listener in a_desk(tmp_path, broken=True):
        worker.engine.track(0, FRAMES, 3)
        notice = listener.refused()
        assert "Traceback" not in notice.text
        worker.engine.set_pose(3, pose_with(listener), 7)
        listener.pose(7)


def test_a6_a_disk_that_is_full_when_tracking_ends_is_told_and_the_page_goes_on(
    halted, monkeypatch
):
    def full(*_):
        raise OSError(28, "No space left on device")

    worker, listener, go_on = halted
    with monkeypatch.context() as patch:
        patch.setattr("os.write", full)
        go_on.set()
        listener.refused()
        listener.told("save the track once there is room")
        worker.engine.show_frame(2)
        listener.wait(protocol.PoseSnapshot, lambda p: p.frame == 2)
    assert not worker.busy
    worker.engine.save_track()
    listener.told("Track saved")


def test_a8_saving_the_first_pose_while_tracking_leaves_the_jobs_model_alone(halted, monkeypatch):
    worker, listener, go_on = halted
    with_arm = load_model("hand26", forearm=True)
    armed = lambda run, *_: replace(run, model=with_arm, arm_m=np.inf)  # noqa: E731
    monkeypatch.setattr(FakeRun, "with_arm_in_view", armed)
    worker.engine.save_pose()
    listener.told("First-frame pose saved")
    go_on.set()
    listener.told("Tracking finished")
    assert not any(notice.level == "error" for notice in listener.notices)
    assert len(worker.document.results) == FRAMES
    worker.engine.save_pose()  # now it may
    names = with_arm.parameter_names
    listener.wait(protocol.SessionSnapshot, lambda told: told.parameter_names == names)


def test_a_camera_that_the_others_contradict_is_named_when_a_track_is_opened_again(
    tmp_path, monkeypatch
):
    for worker, listener in a_desk(tmp_path):
        track_all(worker, listener, 0)
    compared = list[int]()

    def contradicted(run, results):
        compared.extend(result.frame for result in results)
        return "camera 'left' contradicts the others"

    monkeypatch.setattr(open_session, "inconsistency_of_cameras", contradicted)
    for _, listener in a_desk(tmp_path):
        assert listener.told("contradicts the others").level == "warning"
    assert compared == list(range(FRAMES))


def test_a_pose_that_does_not_fit_is_asked_about_before_it_is_the_first(tmp_path):
    beside = Reason("beside", camera="front", number=900.0, other=0.76)
    for worker, listener in a_desk(tmp_path, doubt=beside):
        worker.engine.save_pose()
        listener.wait(protocol.Notice, lambda n: n.level == "warning" and "900" in n.text)
        assert not (tmp_path / "init.json").exists()
        worker.engine.save_pose()
        listener.told("First-frame pose saved")
        assert (tmp_path / "init.json").exists()


def test_the_size_is_fitted_before_the_first_tracking_in_sight_and_cancelled_at_once(tmp_path):
    go_on = threading.Event()
    for worker, listener in a_desk(tmp_path, size_pending=True, sizing=lambda: go_on.wait(600.0)):
        rest = listener.wait(protocol.PoseSnapshot).values
        worker.engine.track(0, FRAMES, 3)
        tried = listener.wait(protocol.PoseSnapshot, lambda pose: pose.frame == 5)
        assert tried.values != pytest.approx(rest, abs=0.01), "in the pose just tracked"
        assert not worker.document.results, "nothing of it is kept"
        worker.engine.cancel()
        listener.told("Cancelled")
        assert worker.document.shown == pytest.approx(rest)
        assert not go_on.is_set(), "it waited until the size was fitted"
        go_on.set()
        time.sleep(0.2)
        sized = lambda: sum(n.title == "Size fitted" for n in listener.notices)  # noqa: B023, E731
        assert not sized()
        track_all(worker, listener)
        assert listener.wait(protocol.SessionSnapshot, lambda s: "size 1.10" in s.model)
        worker.engine.track(0, FRAMES, 3)
        worker.engine.cancel()
        assert sized() == 1


def test_the_size_is_fitted_after_tracking_and_all_is_tracked_again(tmp_path):
    for worker, listener in a_desk(tmp_path, size_pending=True, step_s=0.0):
        worker.engine.set_setting("model.fit_size", "later")
        worker.engine.set_pose(8, pose_with(listener, index_mcp_flex=0.3), 1)
        track_all(worker, listener, anew=True)
        titles = [notice.title for notice in listener.notices]
        assert titles == ["Size fitted", "Tracking finished"]
        document = worker.document
        assert document.run.scale == HandScale(1.1) and not document.size.pending
        assert [span.take for span in document.laid][-1] == 2, "all is tracked again with it"
        assert sorted(document.results) == [f for f in range(FRAMES) if f != 8]
        index = document.model.parameter_names.index("index_mcp_flex")
        assert document.by_hand[8][index] == pytest.approx(0.3), "a pose set by hand is not lost"


def edit(worker, listener, frame, version):
    worker.engine.set_pose(frame, pose_with(listener, index_mcp_flex=0.1), version)
    listener.pose(version)


def test_c66_without_any_keyframe_all_goes_on_and_forgetting_is_undone_after_a_restart(tmp_path):
    for worker, listener in a_desk(tmp_path):
        edit(worker, listener, 5, 1)
        worker.engine.forget_pose(5, 2)
        listener.pose(2)
        assert not worker.document.by_hand
        track_all(worker, listener)
        assert len(worker.document.results) == FRAMES
    for worker, listener in a_desk(tmp_path):
        assert not worker.document.by_hand
        for version in (3, 4):  # tracking, and forgetting
            worker.engine.undo(version)
            listener.pose(version)
        assert list(worker.document.by_hand) == [5]


def written(folder):
    """Return the frames whose poses are on disk, in their order."""
    actions = Store(folder / "tracks").actions()
    changed = [key_of(c.key) for action in actions for c in action.changes]
    return [frame for kind, frame in changed if kind == "pose"]


def test_a7_an_edit_that_could_not_be_written_is_tried_again_with_the_next(
    worker, listener, tmp_path, monkeypatch
):

    def full(_action):
        raise HandtrackError("the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(worker.session.store.store, "write", full)
        edit(worker, listener, 5, 1)
        listener.told("the disk is full")
    worker.engine.show_frame(6)  # one can look around meanwhile
    listener.wait(protocol.PoseSnapshot, lambda p: p.frame == 6)
    assert written(tmp_path) == []
    edit(worker, listener, 8, 2)
    worker.stop()
    assert written(tmp_path) == [5, 8]
    assert sum("full" in notice.text for notice in listener.notices) == 1


def test_a15_a_drag_that_goes_on_and_on_is_written_meanwhile(
    worker, listener, tmp_path, monkeypatch
):
    monkeypatch.setattr(persistence, "_QUIET_S", float("inf"))  # it never rests
    monkeypatch.setattr(persistence, "_LONGEST_S", 0.05)
    edit(worker, listener, 3, 1)
    eventually(lambda: written(tmp_path) == [3])
