"""A left hand tracked as a right one, and the other way round: told where silhouettes decide (fault C31)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from handtrack.arrays import Floats
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.observation.observation import Observation
from handtrack.session.bundled import bundled_session
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.side import doubt_of_side
from handtrack.tracking.search.other_side import evidence_of_other_side


@pytest.fixture(scope="module")
def run() -> TrackingRun:
    """A right hand that is open at first, seen by three cameras."""
    return TrackingRun.open(
        Session.open(bundled_session("open_fist_open")), {"model.fit_size": "false"}
    )


def backwards(model: ArticulatedModel, joint: Floats) -> Floats:
    """Return a hand's pose whose palm looks where its back did: where the other hand's outlines are like this one's."""
    turned = joint.copy()
    turn = rotation_matrix(joint[3:6]) @ rotation_matrix(np.array([0.0, np.pi, 0.0]))
    turned[3:6] = rotation_vector(turn)
    return model.transform.solver_params(turned)


@pytest.mark.parametrize("wrong", [False, True])
def test_c31_the_side_is_told_by_silhouettes(wrong: bool, run: TrackingRun) -> None:
    frame, params = run.initial()
    seen = run.seen(frame)
    hands = [
        load_model("hand26", side, run.scale, forearm=run.forearm) for side in ("right", "left")
    ]
    start = backwards(hands[1], run.model.joint_params(params)) if wrong else params
    looks = [(seen, start)]
    odds = evidence_of_other_side(*(hands[::-1] if wrong else hands), run.settings, looks)
    assert odds > 3 if wrong else odds < -3


def test_c31_nothing_is_told_unless_it_is_decisive(
    run: TrackingRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame, params = run.initial()
    tracked = {frame + i: run.model.joint_params(params) for i in range(9)}
    looked_at: list[int] = []

    def evidence(odds: float, *given: object) -> float:
        looks: Iterator[tuple[Observation, Floats]] = given[3]  # type: ignore[assignment]
        looked_at[:] = [seen.frame for seen, _ in looks]
        return odds

    for odds, told in ((4.9, False), (5.1, True)):
        monkeypatch.setattr(
            "handtrack.session.side.evidence_of_other_side", lambda *a, o=odds: evidence(o, *a)
        )
        text = doubt_of_side(run.session, run.settings, run.model, tracked)
        assert bool(text) == told
        assert looked_at == [frame, frame + 3, frame + 5, frame + 8]
    assert text.startswith("a left hand fits what was seen decisively better than a right one")
    assert 'side = "right"' in text
