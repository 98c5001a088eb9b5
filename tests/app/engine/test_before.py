"""A look at the pose before the last step: it changes nothing, ends with whatever is done next, and is known after a restart."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from handtrack_app.engine.document_snapshots import pose_snapshot
from handtrack_app.engine.posing.pose_service import pose_before
from handtrack_app.engine.store import edits
from handtrack_app.engine.worker import Worker
from handtrack_app.protocol import snapshots
from tests.app.engine.test_worker import Listener, _desk
from tests.app.opened import opened, posed, tracked


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[tuple[Worker, Listener]]:
    yield from _desk(tmp_path, step_s=0.0)


def test_it_is_the_pose_before_the_last_step_that_changed_this_frame(
    tmp_path: Path, left_open: None
) -> None:
    store = opened(tmp_path)
    document = store.document
    document.show(5)
    assert pose_before(document, store.history) is None, "no step was taken"
    posed(store, 5, by=0.05)
    tracked(store, first=3)
    posed(store, 5, by=0.1)
    posed(store, 6, by=0.2)
    store.do("A setting", edits.setting("silhouettes.weight", 2.0))
    document.show(5)
    was = pose_before(document, store.history)
    assert was is not None
    np.testing.assert_allclose(was[6:], document.start[6:] + 0.05, atol=1e-9)
    store.undo()
    store.undo()
    store.undo()
    document.show(5)
    np.testing.assert_allclose(document.shown[6:], document.start[6:] + 0.05, atol=1e-9)


def test_of_two_trackings_it_is_the_frame_of_the_one_below(tmp_path: Path, left_open: None) -> None:
    store = tracked(opened(tmp_path), first=3)
    document = store.document
    first = document.results[8].parameters.copy()
    posed(store, 6, by=0.1)
    tracked(store, first=6)
    document.show(8)
    assert not np.allclose(document.shown, first)
    was = pose_before(document, store.history)
    assert was is not None
    np.testing.assert_array_equal(was, first)
    again = opened(tmp_path)
    again.document.show(8)
    back = pose_before(again.document, again.history)
    assert back is not None
    np.testing.assert_allclose(back, first, atol=1e-9)


def test_what_is_looked_at_says_so_and_is_no_edit(tmp_path: Path, left_open: None) -> None:
    store = opened(tmp_path)
    document = store.document
    posed(store, 5, by=0.1)
    document.show(5)
    now, steps = document.shown.copy(), len(store.history.past)
    document.before = pose_before(document, store.history)
    looked = pose_snapshot(document)
    assert looked.origin == snapshots.BEFORE
    assert not np.allclose(looked.values, now)
    assert np.isnan(looked.energy) and looked.std is None and not looked.note
    np.testing.assert_array_equal(document.pose_at(5), now)
    assert len(store.history.past) == steps
    document.show(5)
    assert pose_snapshot(document).origin == "set"


def test_a_key_flips_there_and_back_and_an_edit_goes_on_from_what_is(
    desk: tuple[Worker, Listener],
) -> None:
    worker, listener = desk
    start = listener.wait(snapshots.PoseSnapshot)
    worker.engine.look_before(True)
    listener.wait(snapshots.Notice, lambda n: n.title == "Nothing before")
    worker.engine.take_pose(3, "fist", 1)
    fist = listener.wait(snapshots.PoseSnapshot, lambda p: p.version == 1)
    worker.engine.look_before(True)
    looked = listener.wait(snapshots.PoseSnapshot, lambda p: p.origin == snapshots.BEFORE)
    np.testing.assert_allclose(looked.values, start.values, atol=1e-9)
    worker.engine.look_before(False)
    back = listener.wait(snapshots.PoseSnapshot, lambda p: p is not fist and p.version == 1 and p.origin == "set")  # fmt: skip
    np.testing.assert_array_equal(back.values, fist.values)
    worker.engine.look_before(True)
    tip = fist.joints[worker.document.model.joint_names.index("index_tip")]
    worker.engine.pull_place(3, tuple((tip + (0, 0.01, 0)).tolist()), 2, "index_tip")
    pulled = listener.wait(snapshots.PoseSnapshot, lambda p: p.version == 2)
    others = [
        i for i, n in enumerate(worker.document.model.parameter_names) if not n.startswith("index")
    ]
    np.testing.assert_allclose(pulled.values[others], fist.values[others], atol=1e-9)
    assert pulled.origin == "set"
