"""The card's score is that of the pose shown, with its change since the last fit, and of no other pose."""

import dataclasses

import pytest

from handtrack_app.engine.posing_service import LiveScore
from handtrack_app.protocol.snapshots import ScoreSnapshot
from tests.app.opened import opened, posed, tracked


def _score(pose, **changes):
    known = ScoreSnapshot(pose.frame, tuple(pose.values), {"left": 0.912}, {"silhouettes": 7.0, "priors": 0.5}, {"left": 0.88}, 9.0)  # fmt: skip
    return dataclasses.replace(known, **changes)


@pytest.mark.parametrize("changes", [{}, {"frame": 7}, {"values": (0.0,)}])
def test_the_card_has_the_score_of_its_own_pose_alone(bench, changes):
    panel = bench.layout.pose
    panel.show_score(_score(panel.pose, **changes))
    assert ("overlap" in panel.card.content) == (not changes)


def test_the_engine_scores_the_pose_that_is_shown(tmp_path, left_open):
    store, told = tracked(opened(tmp_path)), []
    document = store.document
    live = LiveScore(document, told.append)
    assert not live.is_due, "nothing was shown yet"
    posed(store, 5, by=0.05)
    document.show(5)
    live.since = 0.0
    live.tell()
    (found,) = told
    assert (found.frame, found.values) == (5, tuple(document.shown.tolist()))
    assert not live.is_due
    live.since = float("inf")  # it has not rested
    assert live.is_due, "what was seen of this frame is at hand"
