"""A hand that may be lost: hands around the last known place are tried, and taken only where they fit clearly better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.tracking.frame.confidence import assess, is_where_joints_are
from handtrack.tracking.frame.frame_task import FrameTask
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import Status, Step
from handtrack.tracking.search.engine import Candidate, improved
from handtrack.tracking.search.global_search import LOST_HAND, GlobalObjective
from handtrack.tracking.search.policy import why_hand_may_be_lost
from handtrack.tracking.search.scores.hand_shapes import (
    hand_shapes,
    palm_middle,
    shape_of,
)

# how far a palm may be from where it was, and how much further each frame
_NEAR_M, _SPEED_M = (0.10, 0.03)


def with_hand_recovered(task: FrameTask, solved: Step) -> Step:
    """Return a frame as it was solved, or at another pose that fits what was seen clearly better, where it is in doubt and no two
    cameras see the joints there.
    """
    model, result = task.model, solved.result
    why = why_hand_may_be_lost(result, task.previous)
    if not why or not model.has_keypoints21:
        return solved
    params = model.solver_params(result.parameters)
    bones = model.bones(params)
    if is_where_joints_are(frame_terms(model, task.settings, task.observation, bones), bones):
        return solved
    if not task.control.searches:
        return replace(solved, search_due=True)
    objective = GlobalObjective.of(task.observation, task.settings)
    if objective is None:
        return solved

    known = [r for r in task.previous if r.status != Status.LOST and np.isfinite(r.energy)]
    last = known[-1] if known else task.previous[-1]
    middle = palm_middle(model, model.solver_params(last.parameters))
    reach = _NEAR_M + _SPEED_M * abs(task.observation.frame - last.frame)
    # of a lost hand nobody knows how far it went: it is looked for everywhere
    is_lost = result.status == Status.LOST
    objective = replace(
        objective,
        shapes=[shape_of(model, last.parameters, "last"), *hand_shapes(model)],
        within=(middle, np.inf if is_lost else reach),
        control=task.control,
    )

    def compared(candidates: Sequence[Candidate]) -> list[Candidate]:
        """Return candidates by the same observation, of which none is taken that is less sure than what stands, or further off than a
        palm goes in a frame and does not fit.
        """
        found = objective.compared(candidates)
        for n, one in enumerate(found):
            if one.solved is None:
                continue
            assessed = _assessed(task, one.solved).result
            far = np.linalg.norm(palm_middle(model, one.params) - middle) > _NEAR_M
            if (far and not assessed.fits) or assessed.p_off_25mm > result.p_off_25mm:
                found[n] = replace(one, cost=np.inf)
        return found

    here = shape_of(model, result.parameters, "last")
    standing = objective.measured(Candidate(model, params, origin="standing pose", shape=here))
    number = task.observation.frame
    best = improved(LOST_HAND, objective, standing, number, why, compared)
    return solved if best.solved is None else _assessed(task, best.solved)


def _assessed(task: FrameTask, solved: Step) -> Step:
    """Return a result with its status judged beside the frames before it."""
    model, result = task.model, solved.result
    bones = model.bones(model.solver_params(result.parameters))
    terms = frame_terms(model, task.settings, task.observation, bones)
    status, reason = assess(terms, bones, result.energy, task.previous)
    was_open = result.reason_kind == "open"
    if status > result.status or (status != Status.TRACKED and was_open):
        return replace(solved, result=replace(result, status=status, reason=reason))
    return solved
