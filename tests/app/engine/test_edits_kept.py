"""Edits reach the disk, each frame's, however they follow one another and whatever failed in between."""

from handtrack import HandtrackError
from handtrack.session.session_state import key_of
from handtrack.store.store import Store
from handtrack_app.engine.store import persistence
from handtrack_app.protocol import snapshots
from tests.app.desk import a_desk, pose_with
from tests.app.waiting import eventually


def written(folder):
    """Return the frames whose poses are on disk, in their order."""
    actions = Store(folder / "tracks").actions()
    changed = [key_of(c.key) for action in actions for c in action.changes]
    return [frame for kind, frame in changed if kind == "pose"]


def edit(worker, listener, frame, version):
    worker.engine.set_pose(frame, pose_with(listener, index_mcp_flex=0.1), version)
    listener.pose(version)


def test_a5_edits_of_two_frames_in_quick_succession_are_both_written(worker, listener, tmp_path):
    edit(worker, listener, 3, 1)
    worker.engine.take_pose(4, "fist", 2)
    listener.pose(2)
    worker.stop()
    assert written(tmp_path) == [3, 4]


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
    listener.wait(snapshots.PoseSnapshot, lambda p: p.frame == 6)
    assert written(tmp_path) == []
    edit(worker, listener, 8, 2)
    worker.stop()
    assert written(tmp_path) == [5, 8]
    assert sum("full" in s.text for s in listener.seen if isinstance(s, snapshots.Notice)) == 1


def test_a15_a_drag_that_goes_on_and_on_is_written_meanwhile(
    worker, listener, tmp_path, monkeypatch
):
    monkeypatch.setattr(persistence, "_QUIET_S", float("inf"))  # it never rests
    monkeypatch.setattr(persistence, "_LONGEST_S", 0.05)
    edit(worker, listener, 3, 1)
    eventually(lambda: written(tmp_path) == [3], "the drag on the disk")


def test_a14_while_tracking_is_paused_every_frame_is_on_disk(tmp_path):
    for worker, listener in a_desk(tmp_path, stuck=lambda frame: frame == 7):
        worker.engine.track(0, 12, 3)
        listener.wait(snapshots.ProgressSnapshot, lambda p: p.done == 4)
        worker.engine.pause(True)
        listener.state("paused")

        results, store = worker.document.results, Store(tmp_path / "tracks")
        eventually(
            lambda shown=results, store=store: (
                len(shown) >= 4 and set(shown) == set(store.frames_of(1))
            ),
            "what is shown is on disk",
        )
        worker.engine.cancel()
