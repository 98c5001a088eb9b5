"""The worker's protocol: picklable both ways, latest wins, cancel at once, mistakes in words."""

from __future__ import annotations

import pickle
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.tracking.frame.reason import Reason
from handtrack_app.engine import jobs
from handtrack_app.engine.worker import Worker
from handtrack_app.protocol import snapshots
from handtrack_app.protocol.calls import Call
from handtrack_app.protocol.mailbox import Mailbox
from tests.app.calls import call
from tests.app.fake_run import FRAMES, FakeRun, fake_document


class Listener:
    """Keeps every snapshot, pickled and unpickled as a process would get it."""

    def __init__(self) -> None:
        self.seen: list[snapshots.Snapshot] = []
        self._came = threading.Condition()

    def publish(self, snapshot: snapshots.Snapshot) -> None:
        copy = pickle.loads(pickle.dumps(snapshot))
        with self._came:
            self.seen.append(copy)
            self._came.notify_all()

    def wait(
        self, kind: type, test: Callable[[Any], bool] = lambda _: True, timeout: float = 60.0
    ) -> Any:
        """Return the first snapshot of a kind that passes the test, waiting for it."""

        def find() -> Any:
            return next((s for s in list(self.seen) if isinstance(s, kind) and test(s)), None)

        with self._came:
            assert self._came.wait_for(lambda: find() is not None, timeout), (
                f"no {kind.__name__} came"
            )
            return find()


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[tuple[Worker, Listener]]:
    yield from _desk(tmp_path)


def _desk(folder: Path, **options: Any) -> Iterator[tuple[Worker, Listener]]:
    listener = Listener()
    worker = Worker(folder, listener.publish, lambda f, o: fake_document(f, o, **options))
    worker.start()
    listener.wait(snapshots.ProgressSnapshot, lambda p: p.state == "idle")
    yield worker, listener
    worker.stop()


def _pose(listener: Listener, **changes: float) -> tuple[float, ...]:
    session, pose = listener.wait(snapshots.SessionSnapshot), listener.wait(snapshots.PoseSnapshot)
    values = dict(zip(session.parameter_names, pose.values, strict=True)) | changes
    return tuple(float(v) for v in values.values())


def test_opening_shows_the_session_and_its_first_pose(desk: tuple[Worker, Listener]) -> None:
    session = desk[1].wait(snapshots.SessionSnapshot)
    pose = desk[1].wait(snapshots.PoseSnapshot)
    assert (session.start, session.stop, session.first_frame) == (0, FRAMES, 3)
    assert pose.frame == 3
    assert pose.error_mm == pytest.approx(0.0, abs=1e-6)
    assert len(session.cameras) == 2


def test_newest_pose_and_frame_win_and_nothing_else_is_dropped() -> None:
    box: Mailbox[Call] = Mailbox(lambda c: c.key)
    for version in range(5):
        box.put(call("set_pose", 0, (), version))
        box.put(call("show_frame", version))
        box.put(call("export", "csv", version))
    kept = [box.take(0.0) for _ in range(len(box))]
    assert [(c.name, *c.arguments.values()) for c in kept if c is not None] == [
        *(("export", "csv", n) for n in range(4)),
        ("set_pose", 0, (), 4),
        ("show_frame", 4),
        ("export", "csv", 4),
    ]


def test_the_newest_progress_of_each_state_is_told_however_late() -> None:
    box = Mailbox[Any](snapshots.kind_of)
    for state, done in (("idle", 0), ("tracking", 1), ("tracking", 2), ("idle", 0)):
        box.put(snapshots.ProgressSnapshot(state, "", done))
    told = [box.take(0.0) for _ in range(len(box))]
    assert [(one.state, one.done) for one in told] == [("tracking", 2), ("idle", 0)]


def test_a_pose_is_moved_into_its_limits(desk: tuple[Worker, Listener]) -> None:
    worker, listener = desk
    worker.engine.set_pose(
        3, _pose(listener, index_mcp_flex=50.0, root_tx=1e30, root_ty=float("nan")), 1
    )
    pose = listener.wait(snapshots.PoseSnapshot, lambda p: p.version == 1)
    session = listener.wait(snapshots.SessionSnapshot)
    index = session.parameter_names.index("index_mcp_flex")
    assert pose.values[index] == pytest.approx(session.interval[index, 1])
    assert np.isfinite(pose.centre).all()
    assert pose.origin == "set"


def test_a_pose_of_a_wrong_length_changes_nothing(desk: tuple[Worker, Listener]) -> None:
    worker, listener = desk
    worker.engine.set_pose(3, (1.0, 2.0), 1)
    pose = listener.wait(snapshots.PoseSnapshot, lambda p: p.version == 1)
    np.testing.assert_allclose(pose.values, listener.wait(snapshots.PoseSnapshot).values)


def test_tracking_gives_every_frame_and_then_is_idle(desk: tuple[Worker, Listener]) -> None:
    worker, listener = desk
    worker.engine.track(0, FRAMES, 3)
    listener.wait(snapshots.Notice, lambda n: n.title == "Tracking finished")
    strip = listener.wait(snapshots.TimelineSnapshot, lambda s: (s.status >= 0).all())
    assert strip.status[7] == 1
    assert np.isfinite(strip.error_mm).all()
    progress = [s for s in listener.seen if isinstance(s, snapshots.ProgressSnapshot)]
    assert max(p.done for p in progress) == FRAMES
    assert progress[-1].state == "idle"


def test_cancel_takes_effect_within_the_frame_under_way(tmp_path: Path) -> None:
    for worker, listener in _desk(tmp_path, stuck=lambda frame: frame == 5):
        worker.engine.track(0, FRAMES, 3)
        listener.wait(snapshots.ProgressSnapshot, lambda p: p.done == 2)
        worker.engine.cancel()
        listener.wait(snapshots.Notice, lambda n: n.title == "Cancelled")
        assert sorted(worker.document.results) == [3, 4]


def test_pause_holds_and_goes_on(tmp_path: Path) -> None:
    held = threading.Event()
    for worker, listener in _desk(tmp_path, stuck=lambda frame: frame == 5 and not held.is_set()):
        worker.engine.track(0, FRAMES, 3)
        listener.wait(snapshots.ProgressSnapshot, lambda p: p.done == 2)
        worker.engine.pause(True)
        listener.wait(snapshots.ProgressSnapshot, lambda p: p.state == "paused")
        held.set()
        time.sleep(0.3)
        assert sorted(worker.document.results) == [3, 4]
        worker.engine.pause(False)
        listener.wait(snapshots.Notice, lambda n: n.title == "Tracking finished")


def test_posing_goes_on_while_tracking(tmp_path: Path) -> None:
    for worker, listener in _desk(tmp_path, stuck=lambda _: True):
        worker.engine.track(0, FRAMES, 3)
        for version in (1, 2, 3):  # none of them waits for a frame
            values = _pose(listener, index_mcp_flex=0.01 * version)
            worker.engine.set_pose(5, values, version)
            listener.wait(snapshots.PoseSnapshot, lambda p, v=version: p.version == v)
        assert worker.busy
        worker.engine.cancel()


def test_a_job_waits_while_somebody_moves_the_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "_GIVES_WAY_S", 1e6)
    job, asked = jobs.BackgroundJob(1, range(3), lambda _report: None), list[bool]()
    assert not job.should_stop()
    job.give_way()
    stepping = threading.Thread(target=lambda: asked.append(job.should_stop()), daemon=True)
    stepping.start()
    assert not asked
    job.cancel()
    stepping.join(60.0)
    assert asked == [True], "it waits, and can be ended"


def test_a_drag_holds_the_job_and_stays_in_sight(tmp_path: Path) -> None:
    for worker, listener in _desk(tmp_path, stuck=lambda _: True):
        held: list[int] = []
        worker.engine.track(0, FRAMES, 3)
        listener.wait(snapshots.ProgressSnapshot, lambda p: p.state in ("tracking", "preparing"))
        session = worker._session
        assert session is not None
        session.jobs.give_way = partial(held.append, 1)  # type: ignore[method-assign]
        worker.engine.set_pin(3, "front", (40.0, 40.0), 1, "index_tip")
        assert held and not session.jobs.follow, "what is tracked is not shown over it"
        worker.engine.cancel()


def test_an_error_of_the_user_comes_in_words(desk: tuple[Worker, Listener]) -> None:
    worker, listener = desk
    worker.engine.set_setting("silhouettes.wieght", 2.0)
    notice = listener.wait(snapshots.Notice, lambda n: n.level == "error")
    assert notice.text.startswith("no setting 'silhouettes.wieght'; known: ")
    worker.engine.track(500, 600, 3)
    listener.wait(snapshots.Notice, lambda n: n.text.startswith("No frames to track: 500 to 600"))


def test_a_mistake_of_ours_ends_the_job_and_not_the_worker(tmp_path: Path) -> None:
    for worker, listener in _desk(tmp_path, broken=True):
        worker.engine.track(0, FRAMES, 3)
        notice = listener.wait(snapshots.Notice, lambda n: n.level == "error")
        assert "ValueError: a mistake of ours" in notice.text
        assert "Traceback" not in notice.text
        worker.engine.set_pose(3, _pose(listener), 7)
        listener.wait(snapshots.PoseSnapshot, lambda p: p.version == 7)


def test_settings_stay_fixed_while_tracking(tmp_path: Path) -> None:
    for worker, listener in _desk(tmp_path, stuck=lambda _: True):
        worker.engine.track(0, FRAMES, 3)
        worker.engine.set_setting("model.coupling", "21")
        listener.wait(
            snapshots.Notice, lambda n: n.text.startswith("Settings stay fixed while tracking runs")
        )
        worker.engine.cancel()


def test_a6_a_disk_that_is_full_when_tracking_ends_is_told_and_the_page_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    is_full = threading.Event()
    for worker, listener in _desk(tmp_path, stuck=lambda f: f == 5 and not is_full.is_set()):
        with monkeypatch.context() as patch:
            worker.engine.track(0, FRAMES, 3)
            listener.wait(snapshots.ProgressSnapshot, lambda p: p.done == 2)
            patch.setattr("os.write", full)
            is_full.set()
            notice = listener.wait(snapshots.Notice, lambda n: n.level == "error")
            assert "could not be written (No space left on device)" in notice.text
            listener.wait(snapshots.Notice, lambda n: "save the track once there is room" in n.text)
            worker.engine.show_frame(2)
            listener.wait(snapshots.PoseSnapshot, lambda p: p.frame == 2)
        assert not worker.busy
        worker.engine.save_track()
        listener.wait(snapshots.Notice, lambda n: n.title == "Track saved")


def test_a8_saving_the_first_pose_while_tracking_leaves_the_jobs_model_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_arm, is_saved = load_model("hand26", forearm=True), threading.Event()
    for worker, listener in _desk(tmp_path, stuck=lambda f: f == 5 and not is_saved.is_set()):
        worker.engine.track(0, FRAMES, 3)
        listener.wait(snapshots.ProgressSnapshot, lambda p: p.done == 2)
        monkeypatch.setattr(
            FakeRun,
            "with_arm_in_view",
            lambda run, *_: replace(run, model=with_arm, forearm=True),
        )
        worker.engine.save_pose()
        listener.wait(snapshots.Notice, lambda n: n.title == "First-frame pose saved")
        is_saved.set()
        listener.wait(snapshots.Notice, lambda n: n.title == "Tracking finished")
        assert not [
            s for s in listener.seen if isinstance(s, snapshots.Notice) and s.level == "error"
        ]
        assert len(worker.document.results) == FRAMES
        worker.engine.save_pose()  # now it may
        listener.wait(
            snapshots.SessionSnapshot,
            lambda s: s.parameter_names == with_arm.parameter_names,
        )


def test_a_coupling_makes_joints_follow(desk: tuple[Worker, Listener]) -> None:
    worker, listener = desk
    worker.engine.set_setting("model.coupling", "21")
    session = listener.wait(snapshots.SessionSnapshot, lambda s: bool(s.driven))
    assert set(session.driven) == {"thumb_ip_flex"} | {
        f"{f}_dip_flex" for f in ("index", "middle", "ring", "little")
    }
    worker.engine.set_pose(3, _pose(listener, index_pip_flex=0.6), 9)
    pose = listener.wait(snapshots.PoseSnapshot, lambda p: p.version == 9)
    values = dict(zip(session.parameter_names, pose.values, strict=True))
    assert values["index_pip_flex"] == pytest.approx(0.6)
    assert values["index_dip_flex"] == pytest.approx(0.4)


def test_limits_are_live(desk: tuple[Worker, Listener]) -> None:
    worker, listener = desk
    worker.engine.set_limits("index_mcp_flex", (0.0, 0.2))
    session = listener.wait(
        snapshots.SessionSnapshot, lambda s: not np.array_equal(s.interval, s.own_interval)
    )
    index = session.parameter_names.index("index_mcp_flex")
    np.testing.assert_allclose(session.interval[index], [0.0, 0.2])
    worker.engine.set_pose(3, _pose(listener, index_mcp_flex=1.0), 4)
    pose = listener.wait(snapshots.PoseSnapshot, lambda p: p.version == 4)
    assert pose.values[index] == pytest.approx(0.2)
    worker.engine.set_limits("index_mcp_flex", None)
    listener.wait(
        snapshots.SessionSnapshot,
        lambda s: s is not session and np.array_equal(s.interval, s.own_interval),
    )


def test_a_folder_that_is_no_session_is_told_in_words(tmp_path: Path) -> None:
    listener = Listener()
    worker = Worker(tmp_path / "nothing", listener.publish)
    worker.start()
    notice = listener.wait(snapshots.Notice, lambda n: n.level == "error")
    worker.stop()
    assert "nothing does not exist; expected a session folder" in notice.text


def test_the_size_is_fitted_before_the_first_tracking(tmp_path: Path) -> None:
    for worker, listener in _desk(tmp_path, size_pending=True):
        worker.engine.track(0, FRAMES, 3)
        listener.wait(snapshots.Notice, lambda n: n.title == "Size fitted")
        listener.wait(snapshots.Notice, lambda n: n.title == "Tracking finished")
        assert listener.wait(snapshots.SessionSnapshot, lambda s: "size 1.10" in s.model)
        worker.engine.track(0, FRAMES, 3)
        worker.engine.cancel()
        fitted = [
            s for s in listener.seen if isinstance(s, snapshots.Notice) and s.title == "Size fitted"
        ]
        assert len(fitted) == 1


@pytest.mark.parametrize("joint", ["index_tip", "index_pip"])
def test_a_joint_can_be_pulled(desk: tuple[Worker, Listener], joint: str) -> None:
    worker, listener = desk
    session, before = (
        listener.wait(snapshots.SessionSnapshot),
        listener.wait(snapshots.PoseSnapshot),
    )
    held = session.joint_names.index(joint)
    target = before.joints[held] + np.array([0.0, -0.01, -0.02])
    worker.engine.pull_place(3, tuple(target.tolist()), 5, joint)
    pose = listener.wait(snapshots.PoseSnapshot, lambda p: p.version == 5)
    assert np.linalg.norm(pose.joints[held] - target) < 0.008
    others = [i for i, name in enumerate(session.parameter_names) if not name.startswith("index")]
    np.testing.assert_allclose(pose.values[others], before.values[others], atol=1e-9)


def test_a_pose_of_the_library_moves_the_fingers_only(desk: tuple[Worker, Listener]) -> None:
    worker, listener = desk
    before = listener.wait(snapshots.PoseSnapshot)
    worker.engine.take_pose(3, "fist", 5)
    pose = listener.wait(snapshots.PoseSnapshot, lambda p: p.version == 5)
    np.testing.assert_allclose(pose.values[:6], before.values[:6])
    assert pose.values[session_index(listener, "index_pip_flex")] > 1.0


def session_index(listener: Listener, name: str) -> int:
    return listener.wait(snapshots.SessionSnapshot).parameter_names.index(name)


def test_without_a_first_pose_the_size_is_fitted_from_the_pose_that_was_set(tmp_path: Path) -> None:
    go_on = threading.Event()
    for worker, listener in _desk(tmp_path, size_pending=True, sizing=lambda: go_on.wait(60.0)):
        document = worker.document
        assert document is not None
        document.run = replace(document.run, first=None)
        worker.engine.set_pose(5, _pose(listener, index_mcp_flex=0.3), 1)
        worker.engine.track(0, FRAMES, 5, anew=True)
        told = listener.wait(
            snapshots.ProgressSnapshot, lambda p: "5 of 10 frames tracked" in p.text
        )
        assert (told.done, told.total) == (50, 100)
        go_on.set()
        listener.wait(snapshots.Notice, lambda n: n.title == "Size fitted")
        listener.wait(snapshots.Notice, lambda n: n.title == "Tracking finished")
        assert document.run.first.frame == document.first_frame == 5
        assert not (tmp_path / "init.json").exists()


def test_a_pose_that_does_not_fit_is_asked_about_before_it_is_the_first(tmp_path: Path) -> None:
    beside = Reason("beside", camera="front", number=900.0, other=0.76)
    for worker, listener in _desk(tmp_path, doubt=beside):
        worker.engine.save_pose()
        listener.wait(snapshots.Notice, lambda n: n.level == "warning" and "900" in n.text)
        assert not (tmp_path / "init.json").exists()
        worker.engine.save_pose()
        listener.wait(snapshots.Notice, lambda n: n.title == "First-frame pose saved")
        assert (tmp_path / "init.json").exists()


def test_cancelling_the_size_does_not_wait_for_it(tmp_path: Path) -> None:
    go_on = threading.Event()
    for worker, listener in _desk(tmp_path, size_pending=True, sizing=lambda: go_on.wait(60.0)):
        worker.engine.track(0, FRAMES, 3)
        listener.wait(snapshots.ProgressSnapshot, lambda p: p.state == "preparing")
        worker.engine.cancel()
        listener.wait(snapshots.Notice, lambda n: n.title == "Cancelled")
        assert not go_on.is_set(), "it waited until the size was fitted"
        go_on.set()
        time.sleep(0.2)
        assert not [
            s for s in listener.seen if isinstance(s, snapshots.Notice) and s.title == "Size fitted"
        ]
