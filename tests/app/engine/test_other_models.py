"""Another model is looked at: what was made with the one before comes back with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handtrack_app.engine.document import Document, renamed
from tests.app.fake_run import FRAMES, fake_document


def _use(document: Document, model: str) -> None:
    document.replace_run(document.run.with_values({"model.name": model}))


def test_tracks_poses_and_limits_come_back_with_their_model(tmp_path: Path) -> None:
    document = fake_document(tmp_path, step_s=0.0)
    for result in document.run.track(document.frames, 3, document.model.rest_params()):
        document.accept(result)
    set_by_hand = document.start + 0.01
    document.set_pose(5, tuple(set_by_hand))
    document.set_limits("ring_pip_flex", (0.1, 0.9))
    kept, shown = document.pose_at(5).copy(), document.shown.copy()

    _use(document, "ball6")
    assert len(document.model.parameter_names) == 6
    assert not document.results and not document.limits
    np.testing.assert_allclose(document.by_hand[5], kept[:6])

    _use(document, "hand26")
    assert sorted(document.results) == list(range(FRAMES))
    np.testing.assert_allclose(document.by_hand[5], kept)
    np.testing.assert_allclose(document.shown, shown)
    assert document.limits == {"ring_pip_flex": (0.1, 0.9)}


def test_what_was_changed_with_the_other_model_stays_changed(tmp_path: Path) -> None:
    document = fake_document(tmp_path)
    document.set_pose(5, tuple(document.start + 0.01))
    document.set_pose(6, tuple(document.start + 0.02))
    fingers = document.by_hand[5][6:].copy()
    _use(document, "ball6")
    document.set_pose(5, (0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    document.forget_pose(6)
    _use(document, "hand26")
    assert document.by_hand[5][0] == 0.5
    np.testing.assert_allclose(document.by_hand[5][6:], fingers)
    assert 6 not in document.by_hand


def test_parameters_go_by_name() -> None:
    found = renamed(np.array([1.0, 2.0]), ("a", "b"), ("b", "c"), np.array([8.0, 9.0]))
    np.testing.assert_array_equal(found, [2.0, 9.0])
