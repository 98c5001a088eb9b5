"""Track now, fit the size later: tracking begins at once, and what was fitted afterwards is offered, not forced."""

import threading

import numpy as np
import pytest

from handtrack import HandScale
from handtrack_app.protocol import snapshots
from tests.app.desk import a_desk, pose_with
from tests.app.fake_run import FRAMES
from tests.app.waiting import eventually


@pytest.fixture
def desk(tmp_path):
    for worker, listener in a_desk(tmp_path, size_pending=True, step_s=0.0):
        worker.engine.set_setting("model.fit_size", "later")
        yield worker, listener


def _offered(listener):
    return listener.wait(snapshots.SessionSnapshot, lambda s: s.offered_size is not None)


def _finished(listener):
    told = [s for s in listener.seen if isinstance(s, snapshots.Notice)]
    return sum(s.title == "Tracking finished" for s in told)


def test_the_size_is_fitted_after_tracking_and_offered(desk):
    worker, listener = desk
    worker.engine.set_pose(8, pose_with(listener, index_mcp_flex=0.3), 1)
    worker.engine.track(0, FRAMES, 3, anew=True)
    offer = _offered(listener)
    assert (offer.size, offer.offered_size, offer.size_pending) == (1.0, 1.1, True)
    titles = [s.title for s in listener.seen if isinstance(s, snapshots.Notice)]
    assert titles[0] == "Tracking finished"
    listener.told("it was tracked with 1.00")
    assert worker.document.run.scale == HandScale(1.0), "what was tracked keeps its size"

    worker.engine.take_size(8)
    listener.wait(snapshots.SessionSnapshot, lambda s: s.size == 1.1)
    eventually(lambda: _finished(listener) == 2, "everything is tracked again")
    document = worker.document
    assert document.run.scale == HandScale(1.1)
    assert (document.size_pending, document.offered_scale) == (False, None)
    assert sorted(document.results) == [f for f in range(FRAMES) if f != 8]
    index = document.model.parameter_names.index("index_mcp_flex")
    assert document.by_hand[8][index] == pytest.approx(0.3), "a pose set by hand is not lost"


def test_frames_are_seen_while_they_are_tracked_for_the_size(tmp_path):
    sizing = threading.Event()
    for worker, listener in a_desk(tmp_path, size_pending=True, sizing=sizing.wait, step_s=0.0):
        rest = listener.wait(snapshots.PoseSnapshot).values
        worker.engine.track(0, FRAMES, 3)
        tried = listener.wait(snapshots.PoseSnapshot, lambda pose: pose.frame == 5)
        assert np.abs(np.subtract(tried.values, rest)).max() > 0.01, "in the pose just tracked"
        assert not worker.document.results, "nothing of it is kept"
        sizing.set()
        listener.told("Tracking finished")
