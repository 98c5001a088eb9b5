"""Another model is looked at: what was made with the one before comes back with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack_app.engine.posing.page_values import renamed
from handtrack_app.engine.store import edits
from handtrack_app.engine.store.persistence import Persistence
from tests.app.fake_run import FRAMES
from tests.app.opened import did, opened, posed, tracked


def _use(store: Persistence, model: str) -> None:
    did(store, edits.setting("model.name", model))


def test_tracks_poses_and_limits_come_back_with_their_model(tmp_path: Path) -> None:
    store = tracked(opened(tmp_path))
    document = store.document
    posed(store, 5, 0.01)
    did(store, edits.limits(document, "ring_pip_flex", (0.1, 0.9)))
    kept = document.pose_at(5).copy()
    document.show(5)
    shown = document.shown.copy()

    _use(store, "ball6")
    assert len(document.model.parameter_names) == 6
    assert not document.results and not document.limits
    np.testing.assert_allclose(document.by_hand[5], kept[:6])

    _use(store, "hand26")
    assert sorted(document.results) == list(range(FRAMES))
    np.testing.assert_allclose(document.by_hand[5], kept)
    np.testing.assert_allclose(document.shown, shown)
    assert document.limits == {"ring_pip_flex": (0.1, 0.9)}


def test_what_was_changed_with_the_other_model_stays_changed(tmp_path: Path) -> None:
    store = opened(tmp_path)
    document = store.document
    posed(store, 5, 0.01)
    posed(store, 6, 0.02)
    fingers = document.by_hand[5][6:].copy()
    _use(store, "ball6")
    did(store, edits.pose(document, 5, (0.5, 0.0, 0.0, 0.0, 0.0, 0.0)))
    did(store, edits.forgotten_pose(6))
    _use(store, "hand26")
    assert document.by_hand[5][0] == 0.5
    np.testing.assert_allclose(document.by_hand[5][6:], fingers)
    assert 6 not in document.by_hand


def test_parameters_go_by_name() -> None:
    found = renamed(np.array([1.0, 2.0]), ("a", "b"), ("b", "c"), np.array([8.0, 9.0]))
    np.testing.assert_array_equal(found, [2.0, 9.0])


def test_a_take_of_another_model_is_not_brought_back_unseen(tmp_path: Path) -> None:
    store = tracked(opened(tmp_path))
    _use(store, "ball6")
    with pytest.raises(HandtrackError, match="Take 1 was tracked with another model"):
        store.restore_take(1)
