"""A left hand tracked as a right one, and the other way round: told where silhouettes decide (fault C31)."""

import numpy as np
import pytest

from handtrack.arrays import Floats
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.session.bundled import bundled_session
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
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
def test_c31_the_side_is_told_by_silhouettes(wrong, run):
    frame, params = run.initial()
    seen = run.seen(frame)
    hands = [
        load_model("hand26", side, run.scale, forearm=run.forearm) for side in ("right", "left")
    ]
    start = backwards(hands[1], run.model.joint_params(params)) if wrong else params
    looks = [(seen, start)]
    odds = evidence_of_other_side(*(hands[::-1] if wrong else hands), run.settings, looks)
    assert odds > 3 if wrong else odds < -3
