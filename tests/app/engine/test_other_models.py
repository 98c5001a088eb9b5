"""Another model is looked at: what was made with the one before comes back with it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import HandScale
from handtrack.session.session_state import decide
from handtrack_app.engine import edits
from handtrack_app.engine.posing_service import pose as pose_edit
from tests.app.fake_run import FRAMES
from tests.app.opened import did, opened, posed, tracked


def _use(store, model):
    did(store, decide(setting={"model.name": model}))


def test_tracks_poses_and_limits_come_back_with_their_model(tmp_path):
    store = tracked(opened(tmp_path))
    document = store.document
    for frame in (5, 6, 7):
        posed(store, frame, 0.01)
    did(store, decide(limits={"ring_pip_flex": (0.1, 0.9)}))
    kept = document.pose_at(5).copy()
    document.show(5)
    shown, person = document.shown.copy(), HandScale(1.1, {}, {"finger_share": -0.5})
    did(store, edits.size(person))

    _use(store, "ball6")
    assert document.run.scale == HandScale(1.1)
    assert not document.results
    assert_allclose(document.model.limits.interval, document.own_interval)
    assert_allclose(document.by_hand[5], kept[:6])
    did(store, pose_edit(document, 6, (0.5, 0.0, 0.0, 0.0, 0.0, 0.0)))
    did(store, decide(pose={7: None}))

    _use(store, "hand26")
    assert document.run.scale == person
    assert sorted(document.results) == list(range(FRAMES))
    assert_allclose(document.by_hand[5], kept)
    assert document.by_hand[6][0] == 0.5 and 7 not in document.by_hand, "changed meanwhile"
    assert_allclose(document.by_hand[6][6:], kept[6:])
    assert_allclose(document.shown, shown)
    ring = document.model.parameter_names.index("ring_pip_flex")
    assert_allclose(document.model.limits.interval[ring], (0.1, 0.9))
    assert (document.model.limits.interval != document.own_interval).any(axis=1).sum() == 1


def test_a_take_of_another_model_is_brought_back_with_its_model(tmp_path):
    store = tracked(opened(tmp_path))
    _use(store, "ball6")
    assert [(span.take, span.first, span.stop) for span in store.document.hidden] == [
        (1, 0, FRAMES)
    ]
    store.do("Take restored", edits.restored(store.document, 1))
    assert sorted(store.document.results) == list(range(FRAMES)) and not store.document.hidden
    store.undo()
    assert len(store.document.model.parameter_names) == 6 and store.document.hidden


@pytest.mark.parametrize("held_by_another", [False, True])
def test_a_session_opens_with_the_arm_that_its_track_has(tmp_path, held_by_another):
    """Tracked as `handtrack track --init auto` does that finds a forearm: only the take knows of it."""
    store = opened(tmp_path)
    store.document.apply(decide(forearm=np.inf))  # nothing is written of it
    tracked(store).close()
    other = opened(tmp_path) if held_by_another else None
    document = opened(tmp_path).document
    assert document.model.has_forearm and not document.hidden
    assert sorted(document.results) == list(range(FRAMES))
    if other is not None:
        other.close()
