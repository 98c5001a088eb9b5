"""First poses of a hand of unknown size: its size is fitted together with the pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.size import SizeParameters
from handtrack.solver.problem import Problem
from handtrack.tracking.search.engine import Candidate
from handtrack.tracking.search.evidence.hand_shapes import shape_of
from handtrack.tracking.size.sized_problem import fit_size

Resize = Callable[[ArticulatedModel, HandScale], ArticulatedModel]
"""makes the same hand in another size"""


def sized(
    candidate: Candidate,
    problems_around: Sequence[Callable[[Candidate], Problem]],
    resize: Resize,
) -> Candidate:
    """Return a pose with the overall size that explains what was seen best with it.

    The parts keep their shares: one frame, seen with a pose still wrong, would blame a bent finger on its length. What is
    looked at stays the same, so that costs can be compared. problems_around: what pulls a candidate, from far first.
    """
    for problem_around in problems_around:
        model, before = candidate.model, candidate.shape
        assert before is not None, "a candidate of evidence starts from a shape"
        free = np.array([name == "overall" for name in SizeParameters(model).names])
        problem = problem_around(candidate)
        scale, (params,) = fit_size([problem], [candidate.params], free)
        model = resize(model, scale)
        shape = shape_of(model, model.joint_params(params), before.posture)
        shape = replace(shape, reach=before.reach)
        candidate = replace(candidate, model=model, shape=shape, params=params)
    return replace(candidate, origin=f"{candidate.origin}, of another size")
