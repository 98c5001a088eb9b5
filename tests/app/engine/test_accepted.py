"""Accepted frames: neither tracking nor refining changes them, nor bringing another take back; undone, kept, restored."""

from handtrack_app.engine.store import edits
from tests.app.desk import pose_with
from tests.app.engine.test_refine import _bends, _told, _tracked
from tests.app.fake_run import FRAMES
from tests.app.opened import opened, tracked
from tests.app.waiting import eventually

DESK = {"refined_by": 0.3}


def _accept(worker, first, last, on=True):
    worker.engine.accept(((first, last),), on)
    wanted = set(range(first, last + 1))
    eventually(lambda: wanted <= worker.document.accepted or not on, "accepted")


def test_tracking_again_and_refining_leave_accepted_frames(desk, worker, listener):
    _tracked(desk)
    before = _bends(worker)
    _accept(worker, 5, 6)
    worker.engine.set_pose(9, pose_with(listener, index_mcp_flex=0.3), 1)
    worker.engine.track(0, FRAMES, 9)
    eventually(lambda: len(_told(listener, "Tracking finished")) == 2, "tracked again")
    after = _bends(worker)
    assert {f for f in before if after[f] == before[f]} == {5, 6, 9}, "9 is a keyframe"
    worker.engine.refine()
    eventually(lambda: len(_told(listener, "Refined")) == 1, "refined")
    last = _bends(worker)
    assert {f for f in before if last[f] == after[f]} == {5, 6, 9}
    worker.engine.restore_take(1)
    eventually(lambda: len(_told(listener, "Take 1 is the track again")) == 1, "restored")
    restored = _bends(worker)
    assert restored[5] == before[5] and restored[7] != last[7]


def test_an_accepted_frame_is_not_fitted_until_it_is_let_go(desk, worker, listener):
    _tracked(desk)
    _accept(worker, 4, 4)
    worker.engine.track(4, 5, 4)
    listener.told("Frame 4 is accepted")
    _accept(worker, 4, 4, on=False)
    worker.engine.track(4, 5, 4)
    eventually(lambda: bool(_told(listener, "Frame 4 is fitted")), "fitted")


def test_what_is_accepted_is_undone_and_comes_back(tmp_path, left_open):
    store = tracked(opened(tmp_path))
    document = store.document
    store.do("Accepted", edits.accepted(document, range(2, 5), on=True))
    store.do("Accepted", edits.accepted(document, range(7, 8), on=True))
    assert document.accepted == {2, 3, 4, 7}
    store.undo()
    assert document.accepted == {2, 3, 4}
    store.do("Let go", edits.accepted(document, range(3, 4), on=False))
    assert document.state.accepted == ((2, 3), (4, 5))
    again = opened(tmp_path)
    assert again.document.accepted == {2, 4}


def test_frames_without_a_pose_cannot_be_accepted(tmp_path, left_open):
    store = tracked(opened(tmp_path), range(3, 6))
    edit = edits.accepted(store.document, range(FRAMES), on=True)
    assert edit(store.document.state).accepted == ((3, 6),)


def test_a_frame_accepted_while_tracking_runs_stays(tmp_path, left_open):
    store = tracked(opened(tmp_path))
    document, before = store.document, store.document.results[6]
    params = document.start_params(3) + 0.01
    store.begin_take(document.frames, 3, params)
    store.do("Accepted", edits.accepted(document, range(6, 7), on=True))
    for result in document.run.track(document.frames, 3, params):  # type: ignore[attr-defined]
        store.add(result)
    store.end_take(finished=True)
    assert document.results[6] is before
    assert document.results[7].parameters[0] != before.parameters[0]
