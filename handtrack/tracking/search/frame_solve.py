"""One frame, from where the hand is expected to its result: descend, look for lost fingers, doubt a poor cloud, refine.

Where a cloud alone must hold the hand and is poor, its depths are doubted, and the frame says so; or a simpler hand takes the
whole one's place, as in the 2004 paper, section 3.5.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, P, S
from handtrack.geometry.rotation import closest_equivalent, wrapped
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model
from handtrack.solver.covariance import joint_position_jacobian
from handtrack.solver.levenberg_marquardt import SolveSummary, solve
from handtrack.solver.problem import Problem
from handtrack.tracking.frame.constants import DOUBTFUL_CLOUD
from handtrack.tracking.frame.control import Search, Tried
from handtrack.tracking.frame.descent import LAST_GAIN, descend, stage_problem
from handtrack.tracking.frame.frame_task import FrameTask, TrackerState, posed_result
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import FrameResult, Status, Step
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.cloud_terms import Agreement, agreement
from handtrack.tracking.search.engine import Candidate, report
from handtrack.tracking.search.keypoint_start import carried_over
from handtrack.tracking.search.lost_finger import finger_search, with_fingers_recovered

POOR, GOOD = 0.80, 0.88
"""agreement below which a cloud's depths are doubted, and above which they are believed again"""
POOR_CLOUD = Search(
    situation="poor cloud, without other observations",
    when=(
        f"`model.fallback`; agreement below {POOR:g}, until above {GOOD:g}: harmonic mean of the points on the surface and of the "
        "visible surface with points (shares), or the second if it is larger"
    ),
    rounds=(),
    tried="frame schedule with `cloud.doubt_depth`, from the last pose; or the simpler model in `model.fallback`",
    measure="cost",
    taken="always, with low confidence",
    again="next frame, before other searches",
)


def solve_frame(task: FrameTask) -> Step:
    """Return a frame's result by descent from its start."""
    params, terms = task.opened()
    if not terms.has_observations:
        return task.unseen()
    if task.previous and task.previous[-1].poor_cloud and may_distrust_depth(terms):
        doubted, is_poor = solve_doubted(task, terms, params)
        if is_poor:
            return doubted
        params = task.model.solver_params(doubted.result.parameters)
    found, problem, search_due = _descended(task, terms, params)
    bones = task.model.bones(found.params)
    poor = poor_agreement(terms, bones, POOR)
    if poor is not None:
        solved = solve_doubted(task, terms, params, poor)[0]
    else:
        solved = _refined(task, terms, found, problem, bones)
    return replace(solved, search_due=search_due)


def _descended(
    task: FrameTask, terms: FrameTerms, params: Floats
) -> tuple[SolveSummary, Problem, bool]:
    """Return where descent leads from params (P,), and from lost fingers found, if any were, by which problem; and whether they would have been looked
    for, had it been allowed.
    """
    settings, control, number = task.settings, task.control, task.observation.frame
    watch = control.watch(number)
    summary, problem = descend(terms, params, control.should_stop, watch)
    search, why = finger_search(settings, number, summary.cost, terms.views, task.previous)
    if why and terms.cloud is not None:
        seen = agreement(terms.cloud, task.model.bones(summary.params))
        if (
            seen.explained < DOUBTFUL_CLOUD
        ):  # a wrong finger often fits points of other things better
            why = ""
    if why and control.searches:
        found = with_fingers_recovered(terms, summary.params, control, number, why, search)
        if found is not summary.params:
            terms = terms.without_motion().visible_at(task.model.bones(found))
            before = summary.iterations
            summary, problem = descend(terms, found, control.should_stop, watch)
            summary = replace(summary, iterations=before + summary.iterations)
    return summary, problem, bool(why) and not control.searches


def _refined(
    task: FrameTask, terms: FrameTerms, found: SolveSummary, problem: Problem, bones: BonePoses
) -> Step:
    """Return the result at the pose that a cloud gives which lies nearer than usual; as found, elsewhere.

    Poses are compared before, as energies are: with the same spread for all of them.
    """
    exact = None
    fine = terms.sharpened(bones)
    if fine is not terms:
        exact = stage_problem(fine, found.params)
        share = max(task.settings.solver.iterations // fine.stages, 1)
        settings = replace(task.settings.solver, iterations=share, least_gain=LAST_GAIN)
        summary = solve(exact, found.params, settings, task.control.should_stop)
        found = replace(
            found,
            params=summary.params,
            iterations=found.iterations + summary.iterations,
            system=problem.linearize(summary.params),
        )
        exact = exact, summary.system
    return task.solved(terms, found, problem, exact)


def may_distrust_depth(terms: FrameTerms) -> bool:
    """Return whether a cloud alone holds the hand, and something may be done about it where it is poor."""
    chosen = terms.settings
    if terms.cloud is None or terms.views != 1 or terms.keypoints or chosen.cloud.doubt_depth:
        return False
    one = len(terms.cloud.views) == 1  # else lines of sight are not known
    useless = ("none",) if one else ("none", "auto")
    return terms.model.has_keypoints21 and chosen.model.fallback not in useless


def poor_agreement(terms: FrameTerms, bones: BonePoses, below: float) -> Agreement | None:
    """Return what is wrong with a cloud that alone must hold the hand and agrees less than that with it at a pose;
    None where all is well.
    """
    if terms.cloud is None or not may_distrust_depth(terms):
        return None
    found = agreement(terms.cloud, bones)
    # of a hand that was measured the depths are right, whatever else the cloud shows; nothing in view: nothing is wrong
    return found if max(found.share, found.measured) < below else None


def solve_doubted(
    task: FrameTask, terms: FrameTerms, params: Floats[P], poor: Agreement | None = None
) -> tuple[Step, bool]:
    """Return the frame by a poor cloud, solved from the last pose, and whether the cloud is poor indeed.

    Parameters
    ----------
    params
        (P,) where a first frame begins.
    poor
        What is wrong with the cloud where the frame's own descent ended; None after a poor frame: then it is asked
        where this descent ends.
    """
    model, kind, last = task.model, task.settings.model.fallback, task.previous[-1:]
    lost = bool(last) and last[0].status == Status.LOST
    state = TrackerState(results=last, belief=None if lost else task.state.belief)
    cautious = replace(task, settings=poor_cloud_settings(task.settings), state=state)
    if kind == "auto":
        start = model.solver_params(last[0].parameters) if last else params
        solved, origin = solve_frame(_started(cautious, start)), "depths doubted"
    else:
        joint = last[0].parameters if last else model.joint_params(params)
        few, start, whole = simplified(model, joint, kind)
        found = solve_frame(_started(_simpler(cautious, few, start, whole), start)).result
        shown = whole(few.solver_params(found.parameters))
        solved, origin = Step(_in_whole(model, found, shown)), kind
    pose = model.solver_params(solved.result.parameters)
    least = GOOD if poor is None else POOR
    poor = poor or poor_agreement(terms, model.bones(pose), least)
    why = "cloud and hand agree again after a poor frame"
    if poor is not None:
        why = f"cloud and hand agree by {poor.share:.2f}, at least {least:g} is asked for"
    fitted = Candidate(model, pose, solved.result.energy, origin)
    tried: Tried = [(1, ((origin, fitted.cost),))]
    winner = fitted if poor is not None else None
    report(POOR_CLOUD, task.control, task.observation.frame, why, tried, winner)
    if poor is None:
        return solved, False
    reason = Reason(
        "poor cloud", "" if kind == "auto" else kind, number=poor.measured, other=poor.explained
    )
    status = max(solved.result.status, Status.DOUBTFUL)
    return replace(solved, result=replace(solved.result, status=status, reason=reason)), True


def _simpler(
    task: FrameTask, few: ArticulatedModel, start: Floats[P], whole: Callable[[Floats], Floats]
) -> FrameTask:
    """Return the frame as the simpler hand sees it; whoever looks on is shown the whole one."""
    shown, transform = task.control.on_iteration, task.model.transform
    joint = few.joint_params(start)
    previous = tuple(replace(result, parameters=joint) for result in task.previous)
    state = replace(task.state, results=previous)

    def watch(number: int, k: int, x: Floats, cost: float) -> None:
        if shown is not None:
            shown(number, k, transform.solver_params(whole(x)), cost)

    control = replace(task.control, on_iteration=watch)
    return replace(task, model=few, state=state, control=control)


def poor_cloud_settings(settings: TrackerSettings) -> TrackerSettings:
    """Return the settings for a poor cloud: doubted depths, and nothing extrapolated or looked for.

    A velocity from two poor poses would be mostly their errors; a lost finger cannot be looked for, nor a lost hand: among
    wrong points another pose often fits better.
    """
    return settings.with_values(
        {
            "cloud.doubt_depth": True,
            "tracker.prediction": "none",
            "tracker.escape": False,
            "tracker.recovery": False,
            "model.fallback": "none",
        }
    )


def simplified(
    model: ArticulatedModel, joint: Floats[S], kind: str
) -> tuple[ArticulatedModel, Floats[P], Callable[[Floats[P]], Floats[S]]]:
    """Return the simpler hand, `glove9` or `ball6`, its solver parameters (P',) where the whole one stands with joint parameters,
    and what turns its solver parameters into the whole hand's joint parameters, fingers kept as they are.

    It is as large as the person's, with the same parts; a simpler hand has no internal proportions.
    """
    few = load_model(kind, model.side, HandScale(model.scale.overall, model.scale.parts))

    def whole(params: Floats) -> Floats:
        held = joint.copy()
        held[:6] = few.joint_params(params)[:6]
        return held

    return few, carried_over(model, model.solver_params(joint), few), whole


def _started(task: FrameTask, params: Floats) -> FrameTask:
    """Return a frame that begins at params (P,) and expects the hand where it was last."""
    start = task.model.clipped(params)
    if not task.previous:
        return replace(task, start=start, expected=None)
    expected = task.previous[-1].parameters.copy()
    expected[3:6] = closest_equivalent(expected[3:6], task.model.joint_params(start)[3:6])
    return replace(task, start=start, expected=expected)


def _in_whole(model: ArticulatedModel, found: FrameResult, joint: Floats[S]) -> FrameResult:
    """Return what a simpler hand found as a result of the whole one, which then has those joint parameters.

    Nothing is said of the fingers: their standard deviations are infinite, and their joints may be as far off as their
    limits let them.
    """
    joint[3:6] = wrapped(joint[3:6])
    params = model.solver_params(joint)
    bones, jacobian, _ = model.linearize(params)
    std = found.parameter_std[:6]
    spread = np.diff(model.limits.bounds(joint), axis=1)[:, 0] ** 2 / 12.0  # anywhere between them
    spread[:6] = np.where(np.isfinite(std), std, 1.0) ** 2
    moves = joint_position_jacobian(model, bones, jacobian)
    return replace(
        posed_result(model, found, params, max(found.status, Status.DOUBTFUL)),
        parameter_std=np.append(std, np.full(len(joint) - 6, np.inf)),
        joint_covariance=np.einsum("jas,s,jbs->jab", moves, spread, moves),
        energy=found.energy,
        energies=found.energies,
        iterations=found.iterations,
        views=found.views,
    )
