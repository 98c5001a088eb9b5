"""One frame, from where the hand is expected to its result: descend, look for lost fingers, doubt a poor cloud, refine."""

from __future__ import annotations

from dataclasses import dataclass, replace

from handtrack.arrays import Floats
from handtrack.solver.levenberg_marquardt import solve
from handtrack.solver.problem import Problem
from handtrack.tracking.frame.constants import DOUBTFUL_CLOUD
from handtrack.tracking.frame.descent import descend, stage_problem
from handtrack.tracking.frame.frame_result import Solved, solved_result
from handtrack.tracking.frame.frame_task import FrameTask
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.terms.cloud_terms import agreement
from handtrack.tracking.search.lost_finger import with_fingers_found
from handtrack.tracking.search.policy import POOR, finger_search
from handtrack.tracking.search.poor_cloud import may_doubt, poor_agreement, solve_doubted


def solve_frame(task: FrameTask) -> Solved:
    """Return a frame's result by descent from its start."""
    params, terms = task.opened()
    if not terms.has_seen:
        return task.unseen(terms)
    if task.previous and task.previous[-1].poor_cloud and may_doubt(terms):
        doubted, is_poor = solve_doubted(task, terms, params, solve_frame)
        if is_poor:
            return doubted
        params = task.model.transform.solver_params(doubted.result.parameters)
    found = _descended(task, terms, params)
    poor = poor_agreement(terms, found.params, POOR)
    if poor is not None:
        solved = solve_doubted(task, terms, params, solve_frame, poor)[0]
    else:
        solved = _refined(task, terms, found)
    return replace(solved, search_due=found.search_due)


@dataclass(frozen=True, eq=False)
class _Descended:
    """Where the schedule ended."""

    params: Floats
    problem: Problem
    """of the last stage"""
    iterations: int
    search_due: bool = False


def _descended(task: FrameTask, terms: FrameTerms, params: Floats) -> _Descended:
    """Return where descent leads from params (P,), and from lost fingers found, if any were."""
    settings, control, number = task.settings, task.control, task.observation.frame
    watch = control.watch(number)
    summary, problem, count = descend(
        task.model, settings.solver, terms, params, control.should_stop, watch
    )
    search, why = finger_search(settings, number, summary.cost, terms.views, task.previous)
    if why and terms.cloud is not None:
        seen = agreement(terms.cloud, task.model, task.model.bones(summary.params))
        if (
            seen.explained < DOUBTFUL_CLOUD
        ):  # a wrong finger often fits points of other things better
            why = ""
    if why and control.searches:
        found = with_fingers_found(terms, summary.params, control, number, why, search)
        if found is not summary.params:
            terms = terms.without_motion().as_seen_at(task.model.bones(found))
            summary, problem, more = descend(
                task.model, settings.solver, terms, found, control.should_stop, watch
            )
            count += more
    return _Descended(summary.params, problem, count, bool(why) and not control.searches)


def _refined(task: FrameTask, terms: FrameTerms, found: _Descended) -> Solved:
    """Return the result at the pose that a cloud gives which lies nearer than usual; as found, elsewhere.

    Poses are compared before, as energies are: with the same spread for all of them.
    """
    params, count, exact = found.params, found.iterations, None
    fine = terms.sharpened(task.model.bones(params))
    if fine is not terms:
        exact = stage_problem(task.model, fine, fine.stages - 1, params)
        share = max(task.settings.solver.iterations // fine.stages, 1)
        settings = replace(task.settings.solver, iterations=share)
        summary = solve(exact, params, settings, task.control.should_stop)
        params, count = summary.params, count + summary.iterations
    return solved_result(
        task.observation, terms, found.problem, params, count, task.previous, task.belief, exact
    )
