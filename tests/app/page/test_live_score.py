"""The card's score is that of the pose shown, with its change since the last fit, and of no other pose."""

import dataclasses

import pytest

from handtrack_app.engine.document_snapshots import pose_snapshot
from handtrack_app.engine.review_service import LiveScore
from handtrack_app.page.panels.pose import pose_card
from handtrack_app.protocol.snapshots import ScoreSnapshot
from tests.app.fake_run import fake_document
from tests.app.opened import opened, posed, tracked


@pytest.fixture
def pose(tmp_path):
    return dataclasses.replace(pose_snapshot(fake_document(tmp_path)), energy=float("nan"))


def _score(pose, **changes) -> ScoreSnapshot:
    known = ScoreSnapshot(pose.frame, tuple(pose.values), {"left": 0.912}, {"silhouettes": 7.0, "priors": 0.5}, {"left": 0.88}, 9.0)  # fmt: skip
    return dataclasses.replace(known, **changes)


@pytest.mark.parametrize("other", ["frame", "values"])
def test_the_score_of_another_pose_is_not_shown(pose, other):
    changes = {"frame": pose.frame + 1} if other == "frame" else {"values": (0.0,)}
    assert "overlap" not in pose_card(pose, _score(pose, **changes))


def test_the_engine_scores_the_pose_that_is_shown(tmp_path, left_open):
    store, told = tracked(opened(tmp_path)), []
    document = store.document
    live = LiveScore(document, told.append)
    assert not live.is_due, "nothing was shown yet"
    posed(store, 5, by=0.05)
    document.show(5)
    live.shown()
    live.tell()
    (found,) = told
    assert (found.frame, found.values) == (5, tuple(document.shown.tolist()))
    assert not live.is_due
    live.shown()
    assert live.is_due, "what was seen of this frame is at hand"
