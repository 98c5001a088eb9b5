"""Which motion says where the hand is next: of the last two frames with a pose, neither too far apart nor too long ago."""

from types import SimpleNamespace

import numpy as np
import pytest

from handtrack import Status, load_model
from handtrack.solver.problem import Problem
from handtrack.terms.priors.priors import GaussianPrior
from handtrack.tracking.frame.prediction import inheriting_doubt, predict

MODEL = load_model()
STEP = 0.012


def place(*frames, at):
    """Return where the wrist is expected (x, in steps), having moved by one step between each two of these frames."""
    previous = []
    for n, (number, status) in enumerate(frames):
        params = np.zeros(26)
        params[0] = n * STEP
        previous.append(SimpleNamespace(frame=number, parameters=params, status=status))
    return predict(MODEL, previous, at)[0] / STEP


def seen(*numbers):
    return [(number, Status.TRACKED) for number in numbers]


@pytest.mark.parametrize(
    ("before", "last", "at", "expected"),
    [
        (0, 1, 2, 2.0),
        (0, 4, 8, 2.0),  # both spans at their longest
        (0, 4, 5, 1.25),
        (0, 1, 5, 5.0),
        (0, 5, 6, 1.0),  # too far apart: the hand stays where it was
        (0, 1, 6, 1.0),  # too long ago
        (8, 4, 0, 2.0),  # backward in time
        (9, 4, 3, 1.0),
        (6, 5, 0, 1.0),
        (0, 2, 1, 1.0),  # between both: they were not tracked in this direction
        (0, 2, 2, 1.0),
        (3, 3, 4, 1.0),
    ],
)
def test_a_motion_goes_on_for_four_frames_and_no_longer(before, last, at, expected):
    assert place(*seen(before, last), at=at) == pytest.approx(expected)


def test_the_last_two_frames_with_a_pose_count():
    frames = [*seen(0, 1, 2), (3, Status.LOST)]
    assert place(*frames, at=4) == pytest.approx(2.0 + 2.0)  # from frame 2 on, by a step a frame
    assert place((0, Status.LOST), *seen(1), at=2) == pytest.approx(1.0)
    doubtful = [(0, Status.DOUBTFUL), (1, Status.DOUBTFUL)]
    assert place(*doubtful, at=2) == pytest.approx(2.0)


def test_the_prediction_alone_is_as_unsure_as_the_pose_before():
    """The pull to the relaxed hand is no prediction: it stays as sure as it is. (M⁻¹ + C)⁻¹, written out."""
    model = load_model()
    rest = GaussianPrior(model.rest, np.full(26, 0.7), "rest")
    motion = GaussianPrior(model.rest, np.linspace(0.1, 0.3, 26), "motion")
    params, belief = model.rest_params(), np.diag(np.linspace(0.01, 0.2, 26) ** 2)

    def known(*priors):
        return Problem(model, (), priors).linearize(params).hessian

    found = inheriting_doubt(
        Problem(model, (), (rest, motion)), params, known(rest, motion), belief
    )
    unsure = np.linalg.inv(np.linalg.inv(known(motion)) + belief)
    np.testing.assert_allclose(found, known(rest) + unsure, rtol=1e-9)
