"""A hypothesis with its motion: what is carried from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from handtrack.geometry.rotation import left_jacobian, wrapped
from handtrack.sampling.hypotheses import Hypothesis
from handtrack.tracking.hypotheses.motion_belief import MotionBelief


@dataclass(frozen=True, eq=False)
class MovingHypothesis(Hypothesis):
    """A hypothesis that knows how it moves."""

    belief: MotionBelief


def with_wrapped_turn(hypothesis: MovingHypothesis) -> MovingHypothesis:
    """Return the same hypothesis with a root's turn of at most half a turn: who spins would reach 2π, where it is singular."""
    turn = hypothesis.params[3:6]
    if float(np.linalg.norm(turn)) <= np.pi:
        return hypothesis
    params = hypothesis.params.copy()
    params[3:6] = wrapped(turn)
    change = np.eye(len(params))
    change[3:6, 3:6] = np.linalg.solve(left_jacobian(params[3:6]), left_jacobian(turn))
    return replace(
        hypothesis,
        params=params,
        covariance=change @ hypothesis.covariance @ change.T,
        belief=hypothesis.belief.recharted(params, change),
    )
