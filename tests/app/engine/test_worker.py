"""The worker's protocol: picklable both ways, latest wins, cancel at once, mistakes in words."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from handtrack import load_model
from handtrack.tracking.frame.reason import Reason
from handtrack_app.engine import open_session
from handtrack_app.protocol import snapshots
from handtrack_app.protocol.calls import Mailbox
from tests.app.calls import call
from tests.app.desk import a_desk, pose_with
from tests.app.fake_run import FRAMES, FakeRun


def test_newest_pose_and_frame_win_and_nothing_else_is_dropped():
    box = Mailbox(lambda c: c.key)
    for version in range(5):
        for tag in ("index", "ring"):  # moved by another slider it is another step
            box.put(call("set_pose", 0, (), version, tag))
        box.put(call("show_frame", version))
        box.put(call("export", "csv", version))
    kept = [box.take(0.0) for _ in range(len(box))]
    names = [(c.name, c.arguments.get("version")) for c in kept if c.name != "export"]
    assert names[-3:] == [("set_pose", 4), ("set_pose", 4), ("show_frame", None)]
    assert sum(c.name == "export" for c in kept) == 5


def test_a_pose_is_moved_into_its_limits(worker, listener):
    worker.engine.set_pose(
        3, pose_with(listener, index_mcp_flex=50.0, root_tx=1e30, root_ty=float("nan")), 1
    )
    pose = listener.pose(1)
    session = listener.wait(snapshots.SessionSnapshot)
    index = session.parameter_names.index("index_mcp_flex")
    assert pose.values[index] == pytest.approx(session.interval[index, 1])
    assert np.isfinite(pose.centre).all()
    assert pose.origin == "set"


def test_cancel_takes_effect_within_the_frame_under_way(tmp_path):
    for worker, listener in a_desk(tmp_path, stuck=lambda frame: frame == 5):
        worker.engine.track(0, FRAMES, 3)
        listener.wait(snapshots.ProgressSnapshot, lambda p: p.done == 2)
        worker.engine.cancel()
        listener.told("Cancelled")
        assert sorted(worker.document.results) == [3, 4]


def test_pause_holds_and_goes_on(tmp_path):
    held = threading.Event()
    for worker, listener in a_desk(tmp_path, stuck=lambda frame: frame == 5 and not held.is_set()):
        worker.engine.track(0, FRAMES, 3)
        listener.wait(snapshots.ProgressSnapshot, lambda p: p.done == 2)
        worker.engine.pause(True)
        listener.state("paused")
        held.set()
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
    tmp_path, monkeypatch
):
    def full(*_):
        raise OSError(28, "No space left on device")

    is_full = threading.Event()
    for worker, listener in a_desk(tmp_path, stuck=lambda f: f == 5 and not is_full.is_set()):
        with monkeypatch.context() as patch:
            worker.engine.track(0, FRAMES, 3)
            listener.wait(snapshots.ProgressSnapshot, lambda p: p.done == 2)
            patch.setattr("os.write", full)
            is_full.set()
            listener.refused()
            listener.told("save the track once there is room")
            worker.engine.show_frame(2)
            listener.wait(snapshots.PoseSnapshot, lambda p: p.frame == 2)
        assert not worker.busy
        worker.engine.save_track()
        listener.told("Track saved")


def test_a8_saving_the_first_pose_while_tracking_leaves_the_jobs_model_alone(tmp_path, monkeypatch):
    with_arm, is_saved = load_model("hand26", forearm=True), threading.Event()
    for worker, listener in a_desk(tmp_path, stuck=lambda f: f == 5 and not is_saved.is_set()):
        worker.engine.track(0, FRAMES, 3)
        listener.wait(snapshots.ProgressSnapshot, lambda p: p.done == 2)
        monkeypatch.setattr(
            FakeRun,
            "with_arm_in_view",
            lambda run, *_: replace(run, model=with_arm, forearm=True),
        )
        worker.engine.save_pose()
        listener.told("First-frame pose saved")
        is_saved.set()
        listener.told("Tracking finished")
        assert not [
            s for s in listener.seen if isinstance(s, snapshots.Notice) and s.level == "error"
        ]
        assert len(worker.document.results) == FRAMES
        worker.engine.save_pose()  # now it may
        listener.wait(
            snapshots.SessionSnapshot,
            lambda s: s.parameter_names == with_arm.parameter_names,
        )


def test_the_size_is_fitted_before_the_first_tracking(tmp_path):
    for worker, listener in a_desk(tmp_path, size_pending=True):
        worker.engine.track(0, FRAMES, 3)
        listener.told("Size fitted")
        listener.told("Tracking finished")
        assert listener.wait(snapshots.SessionSnapshot, lambda s: "size 1.10" in s.model)
        worker.engine.track(0, FRAMES, 3)
        worker.engine.cancel()
        fitted = [
            s for s in listener.seen if isinstance(s, snapshots.Notice) and s.title == "Size fitted"
        ]
        assert len(fitted) == 1


def test_a_pose_of_the_library_moves_the_fingers_only(worker, listener):
    before = listener.wait(snapshots.PoseSnapshot)
    worker.engine.take_pose(3, "fist", 5)
    pose = listener.pose(5)
    np.testing.assert_allclose(pose.values[:6], before.values[:6])
    assert pose.values[session_index(listener, "index_pip_flex")] > 1.0


def test_a_camera_that_the_others_contradict_is_named_when_a_track_is_opened_again(
    tmp_path, monkeypatch
):
    for worker, listener in a_desk(tmp_path):
        worker.engine.track(0, FRAMES, 0)
        listener.told("Tracking finished")
    compared = list[int]()

    def contradicted(run, results):
        compared.extend(result.frame for result in results)
        return "camera 'left' contradicts the others"

    monkeypatch.setattr(open_session, "inconsistency_of_cameras", contradicted)
    for _, listener in a_desk(tmp_path):
        assert listener.told("contradicts the others").level == "warning"
    assert compared == list(range(FRAMES))


def session_index(listener, name):
    return listener.wait(snapshots.SessionSnapshot).parameter_names.index(name)


def test_a_pose_that_does_not_fit_is_asked_about_before_it_is_the_first(tmp_path):
    beside = Reason("beside", camera="front", number=900.0, other=0.76)
    for worker, listener in a_desk(tmp_path, doubt=beside):
        worker.engine.save_pose()
        listener.wait(snapshots.Notice, lambda n: n.level == "warning" and "900" in n.text)
        assert not (tmp_path / "init.json").exists()
        worker.engine.save_pose()
        listener.told("First-frame pose saved")
        assert (tmp_path / "init.json").exists()


def test_cancelling_the_size_does_not_wait_for_it(tmp_path):
    go_on = threading.Event()
    for worker, listener in a_desk(tmp_path, size_pending=True, sizing=lambda: go_on.wait(60.0)):
        worker.engine.track(0, FRAMES, 3)
        listener.state("preparing")
        worker.engine.cancel()
        listener.told("Cancelled")
        assert not go_on.is_set(), "it waited until the size was fitted"
        go_on.set()
        time.sleep(0.2)
        assert not [
            s for s in listener.seen if isinstance(s, snapshots.Notice) and s.title == "Size fitted"
        ]
