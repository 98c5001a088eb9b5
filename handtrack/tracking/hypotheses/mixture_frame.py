"""One frame solved with several hypotheses: those of the last frame moved on, their mixture, the heaviest as the result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from handtrack.model.articulated import ArticulatedModel
from handtrack.tracking.frame.descent import stage_problem
from handtrack.tracking.frame.frame_result import Solved, solved_result
from handtrack.tracking.frame.frame_task import FrameTask
from handtrack.tracking.frame.result import Alternative
from handtrack.tracking.hypotheses.mixture import MixtureStep
from handtrack.tracking.hypotheses.moving_hypothesis import MovingHypothesis
from handtrack.tracking.hypotheses.next_hypotheses import Component


def solve_mixture(
    step: MixtureStep, task: FrameTask, carried: Sequence[MovingHypothesis]
) -> tuple[Solved, tuple[MovingHypothesis, ...]]:
    """Return a frame at the heaviest of the hypotheses that explain it, and all that are carried on.

    carried: those of the frame before; none in a first frame. Where nothing is seen they stay as they are.
    """
    params, terms = task.opened()
    seen = task.observation
    if not terms.has_seen:
        parents = range(len(carried))
        return _with_alternatives(task.model, task.unseen(terms), carried, parents), tuple(carried)
    if carried:
        components = [_component(step, task, hypothesis) for hypothesis in carried]
        mixture = step.next(seen, components, task.control)
        terms = components[mixture.parents[0]].terms
    else:
        terms = terms.without_motion()
        mixture = step.first(seen, terms, params, task.control)
    best = mixture.hypotheses[0].params
    problem = stage_problem(task.model, terms, terms.stages - 1, best)
    solved = solved_result(seen, terms, problem, best, 0, task.previous, task.belief)
    found = _with_alternatives(task.model, solved, mixture.hypotheses, mixture.parents)
    return found, mixture.hypotheses


def _component(step: MixtureStep, task: FrameTask, hypothesis: MovingHypothesis) -> Component:
    """Return a hypothesis of the last frame moved on to this one."""
    goes_on = task.settings.tracker.prediction == "constant_velocity"
    belief = hypothesis.belief.ahead(step.speed_of_change(), max(task.ahead, 1), goes_on)
    belief = replace(belief, mean=task.model.clipped(belief.mean))
    bones = task.model.bones(hypothesis.params)
    texture = task.texture and replace(task.texture, bones=bones)
    terms = replace(task, expected=None, texture=texture).terms(belief.mean)
    return Component(belief, terms, hypothesis.weight)


def _with_alternatives(
    model: ArticulatedModel,
    solved: Solved,
    carried: Sequence[MovingHypothesis],
    parents: Sequence[int],
) -> Solved:
    alternatives = tuple(
        Alternative(model.joint_params(h.params), h.cost, h.weight, parent, h.origin)
        for h, parent in zip(carried, parents, strict=True)
    )
    return replace(solved, result=replace(solved.result, alternatives=alternatives))
