"""A look at the pose before the last step: it changes nothing, ends with whatever is done next, and is known after a restart."""

import numpy as np

from handtrack.session.session_state import decide
from handtrack_app.engine.posing_service import pose_before
from tests.app.opened import opened, posed, tracked


def test_it_is_the_pose_before_the_last_step_that_changed_this_frame(tmp_path, left_open):
    store = opened(tmp_path)
    document = store.document
    document.show(5)
    assert pose_before(document, store.history) is None, "no step was taken"
    posed(store, 5, by=0.05)
    tracked(store, first=3)
    posed(store, 5, by=0.1)
    posed(store, 6, by=0.2)
    store.do("A setting", decide(setting={"silhouettes.weight": 2.0}))
    document.show(5)
    was = pose_before(document, store.history)
    np.testing.assert_allclose(was[6:], document.start[6:] + 0.05, atol=1e-9)
    store.undo()
    store.undo()
    store.undo()
    document.show(5)
    np.testing.assert_allclose(document.shown[6:], document.start[6:] + 0.05, atol=1e-9)


def test_of_two_trackings_it_is_the_frame_of_the_one_below(tmp_path, left_open):
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
