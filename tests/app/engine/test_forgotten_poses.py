"""Every pose that was set is forgotten again: tracking still goes, after a restart too, and forgetting can be undone then (fault C66)."""

from tests.app.desk import a_desk, pose_with
from tests.app.waiting import eventually


def test_c66_without_any_keyframe_all_goes_on_and_forgetting_is_undone_after_a_restart(
    tmp_path,
):
    for worker, listener in a_desk(tmp_path):
        for version, frame in enumerate((5, 7), 1):
            worker.engine.set_pose(frame, pose_with(listener, index_mcp_flex=0.1), version)
            listener.pose(version)
        for version, frame in enumerate((5, 7), 3):
            worker.engine.forget_pose(frame, version)
            listener.pose(version)
        assert list(worker.document.by_hand) == []
        worker.engine.track(0, 12, 3)
        eventually(lambda w=worker: len(w.document.results) == 12, "all frames are tracked")
    for worker, listener in a_desk(tmp_path):
        assert list(worker.document.by_hand) == []
        steps = 0
        while not list(worker.document.by_hand) and steps < 4:
            steps += 1
            worker.engine.undo(10 + steps)
            listener.pose(10 + steps)
        assert list(worker.document.by_hand) == [7]
