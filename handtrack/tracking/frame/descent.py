"""From starts to minima: the schedule of one start, and many starts at once where only keypoints are seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, N, P, array_dataclass
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.pins import ImagePins
from handtrack.sampling.polish import Minima, polish
from handtrack.solver.levenberg_marquardt import SolverSettings, SolveSummary, solve
from handtrack.solver.problem import Problem
from handtrack.terms.bone_system import JointSystem
from handtrack.tracking.frame.control import Watch
from handtrack.tracking.frame.frame_terms import FrameTerms

_WIDE_GAIN, LAST_GAIN = 0.5, 0.01
"""what a step must gain for another to follow. Costs are negative log-likelihoods: a stage that hands over a start ends by a step that moves
no more than one standard deviation, ½; the last one by a seventh of it. Of three cameras' masks, clouds and stereo 0.6 to 0.8 of the
evaluations are left of those to the last digit, and the mean error is within 0.08 mm, both ways"""


@array_dataclass
class Descended:
    """Where the schedule ended."""

    params: Floats[P]
    problem: Problem
    """of the last stage"""
    iterations: int
    system: JointSystem
    """the problem's at params"""


def stage_problem(
    model: ArticulatedModel, terms: FrameTerms, stage: int, params: Floats[P]
) -> Problem:
    """Return the problem of one stage of the schedule; bands are frozen at params."""
    seen, free = terms.stage(stage, model.bones(params)), terms.settings.solver.limits == "none"
    return Problem(model, seen, terms.priors, unlimited=free)


def descend(
    model: ArticulatedModel,
    settings: SolverSettings,
    terms: FrameTerms,
    params: Floats[P],
    should_stop: Callable[[], bool] | None = None,
    on_iteration: Watch | None = None,
) -> tuple[SolveSummary, Problem, int]:
    """Run the schedule: wide bands first, each from where the one before ended."""
    done, left, likelihoods = 0, settings.iterations, not terms.settings.traits.plain_sums
    for stage in range(terms.stages):
        share = max(left // (terms.stages - stage), 1)
        problem = stage_problem(model, terms, stage, params)
        offset = done

        def watch(k: int, x: Floats, cost: float, offset: int = offset) -> None:
            if on_iteration is not None:
                on_iteration(offset + k, x, cost)

        gain = _WIDE_GAIN if stage + 1 < terms.stages else LAST_GAIN
        stage_settings = replace(settings, iterations=share, least_gain=gain * likelihoods)
        summary = solve(problem, params, stage_settings, should_stop, watch)
        params = summary.params
        done, left = done + summary.iterations, left - summary.iterations
        if summary.why == "stopped":
            break
    return summary, problem, done


def by_keypoints_alone(terms: FrameTerms) -> bool:
    """Return whether keypoints are all that a frame is solved by, so that many starts can be polished at once."""
    plain = all(term.weight == 1.0 for term in terms.keypoints)
    others = terms.views or terms.pins or terms.own or terms.own_priors
    return plain and bool(terms.keypoints) and not others


def minima(
    model: ArticulatedModel,
    settings: SolverSettings,
    terms: FrameTerms,
    starts: Sequence[Floats[N, P]] | Floats[N, P],
    most: int,
    should_stop: Callable[[], bool] | None = None,
    is_far: bool = False,
) -> Minima:
    """Return the minima that starts lead to. Keypoints alone: of all starts; otherwise of the `most` cheapest.

    is_far: the starts may need many iterations, as in a first frame.
    """
    starts = np.asarray(starts)
    if by_keypoints_alone(terms):
        seen = [t.observed for t in terms.keypoints if not isinstance(t.observed, ImagePins)]
        return polish(
            model,
            starts,
            seen,
            terms.priors,
            terms.wide().keypoints[0].loss,
            iterations=200 if is_far else 30,
            tolerance=1e-3,
        )
    if len(starts) > most:
        costs = [stage_problem(model, terms, 0, x).cost(x) for x in starts]
        starts = starts[np.argsort(costs, kind="stable")[:most]]
    params, cost, normal = [], [], []
    for start in starts:
        summary, _, _ = descend(model, settings, terms, start, should_stop)
        params.append(summary.params)
        cost.append(summary.cost)
        normal.append(summary.system.hessian)
        if summary.why == "stopped":
            break
    return Minima(np.array(params), np.array(cost), np.array(normal))
