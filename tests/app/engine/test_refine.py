"""Refining: a take of its own over what was tracked, keyframes alone where nothing else has changed, told in the end."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handtrack.model.articulated import HandScale
from handtrack.observation.pins import Pin
from handtrack.store.store import Store
from handtrack.tracking.whole.refinement import Refinement
from handtrack_app.engine.job_control import Moved, RefinedWith
from handtrack_app.engine.store.tracks import whole_track
from handtrack_app.engine.worker import Worker
from handtrack_app.protocol import snapshots
from tests.app.engine.test_worker import Listener, _desk, _pose
from tests.app.fake_run import FRAMES
from tests.app.waiting import eventually

BY = 0.3


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[tuple[Worker, Listener]]:
    yield from _desk(tmp_path, step_s=0.0, refined_by=BY)


def _told(listener: Listener, title: str) -> list[str]:
    notices = [s for s in listener.seen if isinstance(s, snapshots.Notice)]
    return [s.text for s in notices if s.title == title]


def _bends(worker: Worker) -> dict[int, float]:
    at = worker.document.model.parameter_names.index("index_mcp_flex")
    return {f: float(r.parameters[at]) for f, r in worker.document.results.items()}


def _tracked(desk: tuple[Worker, Listener]) -> None:
    worker, listener = desk
    worker.engine.track(0, FRAMES, 3, anew=True)
    eventually(lambda: len(_told(listener, "Tracking finished")) == 1, "tracked and refined")


def test_what_was_tracked_is_refined_as_a_take_of_its_own(desk: tuple[Worker, Listener]) -> None:
    worker, listener = desk
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
    tmp_path: Path,
) -> None:
    for desk in _desk(tmp_path, step_s=0.0, refined_by=BY, refined_size=1.07):
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


def test_only_what_a_new_keyframe_touches_is_refined_again(desk: tuple[Worker, Listener]) -> None:
    worker, listener = desk
    _tracked(desk)
    before = _bends(worker)
    worker.engine.set_pose(8, _pose(listener, index_mcp_flex=0.3), 1)
    worker.engine.refine()
    eventually(lambda: len(_told(listener, "Refined")) == 1, "refined")
    after = _bends(worker)
    assert {f for f in before if after[f] != before[f]} == {7, 9}
    worker.engine.set_setting("tracker.smoothing", 0.5)
    worker.engine.refine()
    eventually(lambda: len(_told(listener, "Refined")) == 2, "refined again")
    last = _bends(worker)
    assert {f for f in before if last[f] != after[f]} == set(before) - {8}, "another setting"


def test_without_tracked_frames_there_is_nothing_to_refine(desk: tuple[Worker, Listener]) -> None:
    worker, listener = desk
    worker.engine.refine()
    listener.wait(snapshots.Notice, lambda n: "There is nothing to refine" in n.text)


def test_which_keyframes_changed() -> None:
    run, held = object(), {3: np.zeros(2), 5: np.ones(2)}
    pin = Pin("front", (1.0, 2.0), "index_tip")
    known = RefinedWith(run, {"takes": 1}, held, {7: (pin,)})  # type: ignore[arg-type]
    now = {3: np.zeros(2), 5: np.zeros(2), 9: np.ones(2)}
    assert known.changed(replace(known, keyframes=now)) == [5, 9]
    assert known.changed(replace(known, keyframes={3: np.zeros(2)})) is None
    assert known.changed(replace(known, keyframes=dict(held))) is None
    assert known.changed(replace(known, keyframes=now, spans={"takes": 2})) is None
    assert known.changed(replace(known, keyframes=now, run=object())) is None  # type: ignore[arg-type]
    assert known.changed(replace(known, pins={})) is None
    assert known.changed(replace(known, pins={7: (pin, pin), 8: (pin,)})) == [7, 8]


def test_what_moved_is_told() -> None:
    moved = Moved()
    assert moved.words == ""
    moved.frames = 3
    assert moved.words == "Refined together; no joint moved by more than 5 mm."
    moved.most_mm = {4: 7.0}
    assert "1 frame has a joint that moved by more than 5 mm, frame 4 (7 mm)" in moved.words
    moved.most_mm = {4: 7.0, 6: 12.0}
    assert "2 frames have a joint that moved by more than 5 mm, most frame 6 (12 mm)" in moved.words
