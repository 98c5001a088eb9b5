"""Several hypotheses carried over time: searched for, weighed, and those carried on that differ (2003 paper, §4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel
from handtrack.sampling.suppression import apart_joints
from handtrack.solver.covariance import covariance
from handtrack.solver.levenberg_marquardt import SolveSummary
from handtrack.tracking.frame.constants import APART_MM, MIXTURE_DESCENTS
from handtrack.tracking.frame.control import Tried
from handtrack.tracking.frame.descent import by_keypoints_alone, stage_problem
from handtrack.tracking.frame.frame_task import FrameTask
from handtrack.tracking.frame.motion_belief import MotionBelief, unknown_speed
from handtrack.tracking.frame.result import Alternative, Step
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.priors import agility
from handtrack.tracking.hypotheses.mixture_search import (
    FIRST_HYPOTHESES,
    NEXT_HYPOTHESES,
    WEIGHTLESS,
    MixtureObjective,
    Source,
    Start,
)
from handtrack.tracking.search.engine import report, run_rounds


def searched(
    objective: MixtureObjective,
) -> tuple[tuple[MotionBelief, ...], tuple[Alternative, ...]]:
    """Return the hypotheses of a frame, the heaviest of the distinct minima that are found, with the motion of each."""
    search, why = NEXT_HYPOTHESES, f"carried on: {len(objective.components)}"
    if objective.is_first:
        search, why = FIRST_HYPOTHESES, "a first frame"
    tried: Tried = []
    found = run_rounds(search, objective, (), tried=tried)
    found = [c for c in found if np.isfinite(c.cost)]
    if not found:
        raise HandtrackError(
            f"'{objective.model.name}': every pose that was tried lies behind a camera. Look at the first pose and at the "
            "cameras' calibration."
        )
    kept = _carried(objective, objective.distinct(found, len(found)))
    report(search, objective.control, objective.observation.frame, why, tried, kept[0])
    cost = np.array([c.cost for c in kept])
    weights = np.exp(cost.min() - cost)
    weights /= weights.sum()
    hypotheses = [_hypothesis(c, float(w)) for c, w in zip(kept, weights, strict=True)]
    beliefs, alternatives = zip(*hypotheses, strict=True)
    return beliefs, alternatives


def _carried(objective: MixtureObjective, found: Sequence[Start]) -> list[Start]:
    """Return those of the distinct minima, heaviest first, that are carried on.

    First come those to be shown, which differ in shape (the mean over the joints' distances, the root's place apart):
    what nearly looks like a heavier one is no alternative yet. Then the heaviest of the others: where a limb passes
    through the image plane, alternatives begin as small differences.
    """
    model, settings = objective.model, objective.settings
    bones = [model.bones(c.params) for c in found]
    shapes = np.array([model.joint_positions(b) - b.reference for b in bones])
    limit = 0.0 if settings.traits.closest_prior else 1e-3 * APART_MM
    differing = apart_joints(range(len(found)), shapes, limit)
    shown = list(islice(differing, settings.tracker.hypotheses))
    others = [n for n in range(len(found)) if n not in shown]
    quick = by_keypoints_alone(found[0].source.terms)
    more = max(settings.mixture.carried - len(shown), 0) if quick else 0
    return [found[n] for n in [*shown, *others[:more]]]


def _hypothesis(found: Start, weight: float) -> tuple[MotionBelief, Alternative]:
    """Return a minimum's motion, and the minimum as a frame's result has it."""
    params, source = found.params, found.source
    assert found.normal is not None
    spread = covariance(found.normal)[0]
    belief = (
        MotionBelief.at_rest(params, spread, unknown_speed(len(params)))
        if source.belief is None
        else source.belief.updated(params, spread)
    )
    belief = belief.with_wrapped_turn()
    joint = found.model.joint_params(belief.mean)
    return belief, Alternative(joint, found.energy, weight, source.parent, source.origin)


def speed_of_change(model: ArticulatedModel, settings: TrackerSettings) -> Floats[P]:
    """Return (P,) the unknown acceleration a frame, a standard deviation [m, rad]."""
    prior, strength = settings.prior, settings.tracker.smoothing
    push = np.full(len(model.transform.names), np.deg2rad(prior.motion_sigma_deg))
    push[:3] = 1e-3 * prior.motion_sigma_mm
    share = agility(model)
    leaders = [np.flatnonzero(column)[:1] for column in model.transform.matrix.T]
    push *= [float(share[led[0]]) if len(led) else 1.0 for led in leaders]
    return push / np.sqrt(max(strength, 1e-6))


def solve_mixture(task: FrameTask) -> Step:
    """Return a frame at the heaviest of the hypotheses that explain it, and all that are carried on; where nothing is seen they stay as
    they are.
    """
    params, terms = task.opened()
    carried = task.state.beliefs
    known = task.previous[-1].alternatives if carried else ()
    if not terms.has_observations:
        held = tuple(replace(one, parent=n) for n, one in enumerate(known))
        return _with_alternatives(task.unseen(), carried, held)
    components = [Source("start", terms.without_motion(), MIXTURE_DESCENTS)]
    if carried:
        most = max(MIXTURE_DESCENTS // len(carried), 2)
        components = [
            _component(task, belief, one.weight, most, n)
            for n, (belief, one) in enumerate(zip(carried, known, strict=True))
        ]
    about = vars(task) | {"start": params, "components": components}
    beliefs, alternatives = searched(MixtureObjective(**about))
    best, terms = beliefs[0].mean, components[alternatives[0].parent].terms
    problem = stage_problem(terms, best)
    found = SolveSummary(best, 0, "converged", problem.linearize(best))
    solved = task.solved(terms, found, problem)
    return _with_alternatives(solved, beliefs, alternatives)


def _component(
    task: FrameTask, belief: MotionBelief, weight: float, most: int, number: int
) -> Source:
    """Return a hypothesis of the last frame moved on to this one."""
    goes_on = task.settings.tracker.prediction == "constant_velocity"
    push = speed_of_change(task.model, task.settings)
    bones = task.model.bones(belief.mean)
    belief = belief.ahead(push, max(task.ahead, 1), goes_on)
    belief = replace(belief, mean=task.model.clipped(belief.mean))
    texture = task.state.texture and replace(task.state.texture, bones=bones)
    state = replace(task.state, texture=texture)
    terms = replace(task, expected=None, state=state).terms(belief.mean)
    log = float(np.log(max(weight, WEIGHTLESS)))
    return Source("followed", terms, most, belief, number, log)


def _with_alternatives(
    solved: Step, beliefs: tuple[MotionBelief, ...], alternatives: tuple[Alternative, ...]
) -> Step:
    result = replace(solved.result, alternatives=alternatives)
    return replace(solved, result=result, beliefs=beliefs)
