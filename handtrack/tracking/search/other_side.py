"""Whether what was seen is the other hand: a left and a right one, looked for at the same place, are told apart by how well they fit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Observation
from handtrack.tracking.frame.control import Control, Tried
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.engine import Candidate, report, run_rounds
from handtrack.tracking.search.global_search import OTHER_SIDE, GlobalObjective
from handtrack.tracking.search.scores.hand_shapes import (
    hand_shapes,
    palm_middle,
    shape_of,
)

_NEAR_M = 0.10  # how far the other hand's palm may be from this one's


def other_side_log_odds(
    model: ArticulatedModel,
    other: ArticulatedModel,
    settings: TrackerSettings,
    observations: Iterable[tuple[Observation, Floats[P]]],
    control: Control = Control(),
) -> float:
    """Return the log-odds that the hand is the other one; below 0, and looking ends, once this one
    explains more.

    The other hand is looked for around it; where it fits better, this one is looked for likewise,
    so that a poor pose of the right hand does not speak against it.

    Parameters
    ----------
    looks
        What was seen of some frames, and this hand's pose there.
    """
    total = 0.0
    for seen, params in observations:
        objective = GlobalObjective.of(seen, settings)
        if objective is None:
            continue
        shape = shape_of(model, model.joint_params(params), "tracked")
        ours = objective.measured(Candidate(model, params, origin="tracked", shape=shape))
        count = objective.independent_errors(ours)
        objective = replace(
            objective,
            within=(palm_middle(model, params), _NEAR_M),
            control=control,
        )
        theirs = _candidates_of(other, objective, ours.cost)
        least, best = _least_of_each(objective, [ours], theirs)
        if best < least:
            this = [ours, *_candidates_of(model, objective, best)]
            least, best = _least_of_each(objective, this, theirs)
        if control.should_stop():
            return 0.0
        if 0 < least < np.inf and 0 < best < np.inf:  # else nothing of it was seen
            total += 0.5 * count * float(np.log(least / best))
        if total < 0:
            break
    return total


def _least_of_each(
    objective: GlobalObjective, this: Sequence[Candidate], other: Sequence[Candidate]
) -> tuple[float, float]:
    """Return the least cost of this hand's poses and of the other's, by the same pixels."""
    costs = [c.cost for c in objective.compared([*this, *other])]
    return min(costs[: len(this)]), min(costs[len(this) :], default=np.inf)


def _candidates_of(
    hand: ArticulatedModel, objective: GlobalObjective, standing: float
) -> list[Candidate]:
    """Return poses at which a hand was found."""
    objective, tried = replace(objective, shapes=hand_shapes(hand)), Tried()
    found = run_rounds(OTHER_SIDE, objective, [], tried=tried)
    best = min(found, key=lambda c: c.cost, default=None)
    why = f"is it a {hand.side} hand?"
    report(OTHER_SIDE, objective.control, objective.observation.frame, why, tried, best, standing)
    return found
