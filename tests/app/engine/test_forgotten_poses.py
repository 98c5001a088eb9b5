"""Every pose that was set is forgotten again: tracking still goes, after a restart too, and forgetting can be undone then (fault C66)."""

from __future__ import annotations

from pathlib import Path

from handtrack_app.protocol import snapshots
from tests.app.engine.test_worker import _desk, _pose
from tests.app.waiting import eventually


def test_c66_without_any_keyframe_all_goes_on_and_forgetting_is_undone_after_a_restart(
    tmp_path: Path,
) -> None:
    for worker, listener in _desk(tmp_path):
        for version, frame in enumerate((5, 7), 1):
            worker.engine.set_pose(frame, _pose(listener, index_mcp_flex=0.1), version)
            listener.wait(snapshots.PoseSnapshot, lambda p, v=version: p.version == v)
        for version, frame in enumerate((5, 7), 3):
            worker.engine.forget_pose(frame, version)
            listener.wait(snapshots.PoseSnapshot, lambda p, v=version: p.version == v)
        assert list(worker.document.by_hand) == []
        worker.engine.track(0, 12, 3)
        eventually(lambda w=worker: len(w.document.results) == 12, "all frames are tracked")
    for worker, listener in _desk(tmp_path):
        assert list(worker.document.by_hand) == []
        steps = 0
        while not list(worker.document.by_hand) and steps < 4:
            steps += 1
            worker.engine.undo(10 + steps)
            listener.wait(snapshots.PoseSnapshot, lambda p, v=10 + steps: p.version == v)
        assert list(worker.document.by_hand) == [7]
