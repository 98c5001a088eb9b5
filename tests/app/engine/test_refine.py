"""Refining: a take of its own over what was tracked, keyframes alone where nothing else has changed, told in the end."""

import json

import pytest

from handtrack import HandScale
from handtrack.store.store import Store
from handtrack.tracking.whole.refinement import Refinement
from handtrack_app.engine.store.persistence import whole_track
from handtrack_app.protocol import snapshots
from tests.app.desk import a_desk, pose_with
from tests.app.fake_run import FRAMES
from tests.app.waiting import eventually

BY = 0.3


DESK = {"refined_by": BY}


def _told(listener, title):
    notices = [s for s in listener.seen if isinstance(s, snapshots.Notice)]
    return [s.text for s in notices if s.title == title]


def _bends(worker):
    at = worker.document.model.parameter_names.index("index_mcp_flex")
    return {f: float(r.parameters[at]) for f, r in worker.document.results.items()}


def _tracked(desk):
    worker, listener = desk
    worker.engine.track(0, FRAMES, 3, anew=True)
    eventually(lambda: len(_told(listener, "Tracking finished")) == 1, "tracked and refined")


def test_what_was_tracked_is_refined_as_a_take_of_its_own(desk, worker, listener):
    _tracked(desk)
    refined = _bends(worker)
    (text,) = _told(listener, "Tracking finished")
    assert f"{FRAMES} frames have a joint that moved by more than 5 mm" in text
    takes = Store(worker.document.run.session.folder / "tracks").takes()
    assert [take.about.by for take in takes] == ["handtrack open", "handtrack open, refined"]
    assert all(take.is_finished for take in takes)
    worker.engine.undo(1)
    eventually(lambda: _bends(worker) != refined, "undone")
    live = _bends(worker)
    assert [refined[f] - live[f] for f in live] == pytest.approx([BY] * FRAMES)


def test_a_size_that_was_found_with_the_frames_comes_and_goes_with_their_take(
    tmp_path,
):
    for desk in a_desk(tmp_path, step_s=0.0, refined_by=BY, refined_size=1.07):
        worker, _ = desk
        live = worker.document.run.scale
        _tracked(desk)
        assert worker.document.run.scale.overall == 1.07
        takes = Store(worker.document.run.session.folder / "tracks").takes()
        scales = [json.loads(take.about.labels.scale)["overall"] for take in takes]
        assert scales == [live.overall, 1.07]
        assert worker.document.live_scale == live
        told = whole_track(worker.document).refinement
        assert told is not None and Refinement.read(told).scale == HandScale(1.07)
        assert takes[1].about.labels.refinement == told
        worker.engine.undo(1)
        eventually(lambda: worker.document.run.scale == live, "undone")  # noqa: B023
        eventually(lambda: whole_track(worker.document).refinement is None, "undone")  # noqa: B023


def test_only_what_a_new_keyframe_touches_is_refined_again(desk, worker, listener):
    _tracked(desk)
    before = _bends(worker)
    worker.engine.set_pose(8, pose_with(listener, index_mcp_flex=0.3), 1)
    worker.engine.refine()
    eventually(lambda: len(_told(listener, "Refined")) == 1, "refined")
    after = _bends(worker)
    assert {f for f in before if after[f] != before[f]} == {7, 9}
    worker.engine.set_setting("tracker.smoothing", 0.5)
    worker.engine.refine()
    eventually(lambda: len(_told(listener, "Refined")) == 2, "refined again")
    last = _bends(worker)
    assert {f for f in before if last[f] != after[f]} == set(before) - {8}, "another setting"
