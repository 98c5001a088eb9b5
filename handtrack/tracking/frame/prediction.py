"""Where the hand is expected in the next frame, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import Floats, P, S
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.model.articulated import ArticulatedModel
from handtrack.solver.covariance import inherited_information, with_lasting_errors
from handtrack.solver.problem import Problem
from handtrack.terms.priors.priors import GaussianPrior
from handtrack.tracking.frame.constants import POINTS_LAST
from handtrack.tracking.frame.result import FrameResult, Status

_SPAN = 4  # frames; an older motion says nothing about the next one


def predict(
    model: ArticulatedModel, previous: Sequence[FrameResult], frame: int
) -> Floats[S] | None:
    """Return joint parameters at `frame` if the last two frames' motion goes on, or None.

    The wrist's place and all angles go on linearly, the hand's turn as a constant rotation. Needs two
    frames with a pose, not more than a few frames apart (either direction of time).
    """
    posed = [result for result in previous if result.status != Status.LOST]
    if len(posed) < 2:
        return posed[-1].parameters.copy() if posed else None
    before, last = posed[-2], posed[-1]
    gap, ahead = last.frame - before.frame, frame - last.frame
    if gap == 0 or ahead * gap <= 0 or abs(gap) > _SPAN or abs(ahead) > _SPAN:
        return last.parameters.copy()
    share = ahead / gap
    expected = last.parameters + share * (last.parameters - before.parameters)
    turn_before, turn = rotation_matrix(np.stack([before.parameters[3:6], last.parameters[3:6]]))
    turned = rotation_matrix(share * rotation_vector(turn @ turn_before.T)) @ turn
    expected[3:6] = rotation_vector(turned)
    limits = model.limits.bounds(expected)
    return np.clip(expected, limits[:, 0], limits[:, 1])


def inheriting_uncertainty(
    problem: Problem, params: Floats[P], hessian: Floats[P, P], belief: Floats[P, P] | None
) -> Floats[P, P]:
    """Return a frame's matrix in which the prediction is no surer than the pose that it came from.

    hessian: the one that poses are found with, which takes that pose for the truth; belief: its covariance,
    None where nothing is said of it. What is stated must not take it so: a finger hidden for a second would be called as
    well known as after one frame. Nor are a detector's errors new in each frame. A mixture's prediction inherits by itself.
    The live pass alone needs it, which knows no frame after: refined ones state what all frames say together.
    """
    terms = problem.parameter_terms
    motion = [t for t in terms if t.name == "motion" and isinstance(t, GaussianPrior)]
    told = Problem(problem.model, (), motion).linearize(params).hessian
    memory = inherited_information(told, belief)
    sure = hessian - told + memory
    seen = [t for t in problem.observation_terms if t.is_detected]
    if not seen or not motion:
        return sure
    points = Problem(problem.model, seen).linearize(params).hessian
    return with_lasting_errors(sure, memory, points, POINTS_LAST)
