"""One frame, from where the hand is expected to its result: descend, look for lost fingers, doubt a poor cloud, refine."""

from __future__ import annotations

from dataclasses import dataclass, replace

from handtrack.arrays import Floats
from handtrack.solver.levenberg_marquardt import solve
from handtrack.solver.problem import Problem
from handtrack.tracking.frame.descent import descend, stage_problem
from handtrack.tracking.frame.frame_result import Solved, solved_result
from handtrack.tracking.frame.frame_task import FrameTask
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.search.engine import Trial, report
from handtrack.tracking.search.lost_finger import with_fingers_found
from handtrack.tracking.search.policy import GOOD, POOR, POOR_CLOUD, why_fingers_may_be_lost
from handtrack.tracking.search.poor_cloud import (
    Agreement,
    may_doubt,
    poor_agreement,
    solve_doubted,
)


def solve_frame(task: FrameTask) -> Solved:
    """Return a frame's result by descent from its start."""
    params, terms = task.opened()
    if not terms.has_seen:
        return task.unseen(terms)
    if task.previous and task.previous[-1].poor_cloud and may_doubt(terms):
        doubted = solve_doubted(task, params, solve_frame)
        params = task.model.transform.solver_params(doubted.result.parameters)
        poor = poor_agreement(terms, params, GOOD)
        if poor is not None:
            return _doubted(task, poor, GOOD, doubted)
    found = _descended(task, terms, params)
    poor = poor_agreement(terms, found.params, POOR)
    if poor is not None:
        return _doubted(task, poor, POOR, solve_doubted(task, params, solve_frame))
    return _refined(task, terms, found)


def _doubted(task: FrameTask, poor: Agreement, least: float, solved: Solved) -> Solved:
    """Return a frame that was solved with doubted depths, marked and told of."""
    fallback = task.settings.model.fallback
    why = f"cloud and hand agree by {poor.share:.2f}, at least {least:g} is asked for"
    way = Trial("depths doubted" if fallback == "auto" else fallback, solved.result.energy)
    report(POOR_CLOUD, task.control, task.observation.frame, why, float("nan"), way)
    return poor.marked(solved, fallback)


@dataclass(frozen=True, eq=False)
class _Descended:
    """Where the schedule ended."""

    params: Floats
    problem: Problem
    """of the last stage"""
    iterations: int


def _descended(task: FrameTask, terms: FrameTerms, params: Floats) -> _Descended:
    """Return where descent leads from params (P,), and from lost fingers found, if any were."""
    settings, control, number = task.settings, task.control, task.observation.frame
    watch = control.watch(number)
    summary, problem, count = descend(
        task.model, settings.solver, terms, params, control.should_stop, watch
    )
    why = why_fingers_may_be_lost(number, summary.cost, terms.views, task.previous)
    if why and settings.tracker.escape:
        found = with_fingers_found(terms, summary.params, control, number, why)
        if found is not summary.params:
            terms = terms.without_motion().as_seen_at(task.model.bones(found))
            summary, problem, more = descend(
                task.model, settings.solver, terms, found, control.should_stop, watch
            )
            count += more
    return _Descended(summary.params, problem, count)


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
