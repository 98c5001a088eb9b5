"""From starts to minima: the schedule of one start, and many starts at once where only keypoints are seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, N, P
from handtrack.observation.pins import ImagePins
from handtrack.sampling.polish import polish
from handtrack.solver.levenberg_marquardt import SolveSummary, solve
from handtrack.solver.problem import Problem
from handtrack.tracking.frame.control import Watch
from handtrack.tracking.frame.frame_terms import FrameTerms

_WIDE_GAIN, LAST_GAIN = 0.5, 0.01
"""what a step must gain for another to follow. Costs are negative log-likelihoods: a stage that hands over a start ends by a step that moves
no more than one standard deviation, ½; the last one by a seventh of it. Of three cameras' masks, clouds and stereo 0.6 to 0.8 of the
evaluations are left of those to the last digit, and the mean error is within 0.08 mm, both ways"""


def stage_problem(terms: FrameTerms, params: Floats[P], stage: int | None = None) -> Problem:
    """Return the problem of one stage of the schedule, the last unless given; bands are frozen at params."""
    model, free = terms.model, terms.settings.solver.limits == "none"
    return Problem(model, terms.stage(model.bones(params), stage), terms.priors, unlimited=free)


def descend(
    terms: FrameTerms,
    params: Floats[P],
    should_stop: Callable[[], bool] | None = None,
    on_iteration: Watch | None = None,
) -> tuple[SolveSummary, Problem]:
    """Run the schedule: wide bands first, each from where the one before ended. Return where it ended, the iterations of all stages
    counted, and the last stage's problem.
    """
    settings, likelihoods, done = terms.settings.solver, not terms.settings.traits.plain_sums, 0
    for stage in range(terms.stages):
        share = max((settings.iterations - done) // (terms.stages - stage), 1)
        problem = stage_problem(terms, params, stage)

        def watch(k: int, x: Floats, cost: float, before: int = done) -> None:
            if on_iteration is not None:
                on_iteration(before + k, x, cost)

        gain = _WIDE_GAIN if stage + 1 < terms.stages else LAST_GAIN
        stage_settings = replace(settings, iterations=share, least_gain=gain * likelihoods)
        summary = solve(problem, params, stage_settings, should_stop, watch)
        params, done = summary.params, done + summary.iterations
        if summary.why == "stopped":
            break
    return replace(summary, iterations=done), problem


def by_keypoints_alone(terms: FrameTerms) -> bool:
    """Return whether keypoints are all that a frame is solved by, so that many starts can be polished at once."""
    plain = all(term.weight == 1.0 for term in terms.keypoints)
    own = terms.observation.terms or terms.observation.priors
    others = terms.views or terms.pins or own
    return plain and bool(terms.keypoints) and not others


def minima(
    terms: FrameTerms,
    starts: Floats[N, P],
    most: int,
    should_stop: Callable[[], bool] | None = None,
    is_far: bool = False,
) -> tuple[Floats[N, P], Floats[N], Floats[N, P, P]]:
    """Return the minima that starts lead to: solver parameters; costs, infinite where a start led nowhere; Gauss-Newton matrices.

    Keypoints alone: of all starts; otherwise of the `most` cheapest.

    Parameters
    ----------
    is_far
        The starts may need many iterations, as in a first frame.
    """
    if by_keypoints_alone(terms):
        seen = [t.observed for t in terms.keypoints if not isinstance(t.observed, ImagePins)]
        ended = polish(
            terms.model,
            starts,
            seen,
            terms.priors,
            terms.wide().keypoints[0].loss,
            iterations=200 if is_far else 30,
            tolerance=1e-3,
        )
        return ended.params, ended.cost, ended.normal
    if len(starts) > most:
        costs = [stage_problem(terms, x, 0).cost(x) for x in starts]
        starts = starts[np.argsort(costs, kind="stable")[:most]]
    found: list[SolveSummary] = []
    for start in starts:
        found.append(descend(terms, start, should_stop)[0])
        if found[-1].why == "stopped":
            break
    return (
        np.array([one.params for one in found]),
        np.array([one.cost for one in found]),
        np.array([one.system.hessian for one in found]),
    )
