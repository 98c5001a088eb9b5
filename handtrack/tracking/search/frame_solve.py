"""One frame, from where the hand is expected to its result: descend, look for lost fingers, doubt a poor cloud, refine.

Where a cloud alone must hold the hand and is poor, its depths are doubted, and the frame says so; or a simpler hand takes the
whole one's place, as in the 2004 paper, section 3.5. A finger, a forearm or a body's limb that may be lost is put elsewhere, the frame is
solved from there, and the better pose is taken.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice, pairwise, product, takewhile

import numpy as np

from handtrack.arrays import Floats, P, S, array_dataclass
from handtrack.geometry.rotation import wrapped
from handtrack.model.articulated import FINGERS, ArticulatedModel, HandScale
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model
from handtrack.parallel import in_parallel
from handtrack.sampling.suppression import apart
from handtrack.solver.covariance import joint_position_jacobian
from handtrack.solver.levenberg_marquardt import SolveSummary, solve
from handtrack.solver.problem import Problem
from handtrack.tracking.frame.confidence import FEWEST_FRAMES, FRAME_OFF_M, energy_ratio
from handtrack.tracking.frame.constants import BODY_BY_HAND, DOUBTFUL_CLOUD, SEARCH_EVERY
from handtrack.tracking.frame.control import Control, Round, Search, Tried
from handtrack.tracking.frame.descent import LAST_GAIN, descend, stage_problem
from handtrack.tracking.frame.frame_task import FrameTask, TrackerState, posed_result
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import FrameResult, Status, Step
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.cloud_terms import Agreement, agreement
from handtrack.tracking.search.engine import Candidate, each, improved, report
from handtrack.tracking.search.keypoint_start import carried_over

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
    search, why = LOST_FINGER, ""
    if settings.traits.shifts_each_frame:
        search, why = SHIFTED_FINGERS, f"by the method {settings.method}"
    elif settings.tracker.escape:
        why = why_fingers_may_be_lost(number, summary.cost, terms.views, task.previous)
    if why and terms.cloud is not None:
        # a wrong finger often fits points of other things better
        seen = agreement(terms.cloud, task.model.bones(summary.params))
        why = why if seen.explained >= DOUBTFUL_CLOUD else ""
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
    start = model.solver_params(last[0].parameters) if last else params
    if kind == "auto":
        solved, origin = solve_frame(_started(cautious, start)), "depths doubted"
    else:
        solved, origin = _solved_simpler(cautious, start, kind), kind
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


def _started(task: FrameTask, params: Floats) -> FrameTask:
    """Return a frame that begins at params (P,) and expects the hand where it was last."""
    expected = task.previous[-1].parameters if task.previous else None
    return replace(task, start=task.model.clipped(params), expected=expected)


def _solved_simpler(task: FrameTask, params: Floats[P], kind: str) -> Step:
    """Return the frame as a simpler hand finds it, `glove9` or `ball6`, from solver parameters of the whole one, whose fingers are kept as
    they are.

    The simpler hand is as large as the person's, with the same parts; it has no internal proportions. Nothing is said of the fingers: their
    standard deviations are infinite, and their joints may be as far off as their limits let them.
    """
    model, joint, shown = task.model, task.model.joint_params(params), task.control.on_iteration
    few = load_model(kind, model.side, HandScale(model.scale.overall, model.scale.parts))

    def whole(simpler: Floats) -> Floats:
        """Return solver parameters (P,) of the whole hand."""
        joint[:6] = few.joint_params(simpler)[:6]
        joint[3:6] = wrapped(joint[3:6])
        return model.solver_params(joint)

    def watch(number: int, k: int, simpler: Floats, cost: float) -> None:
        if shown is not None:
            shown(number, k, whole(simpler), cost)

    start = carried_over(model, params, few)
    held = tuple(replace(one, parameters=few.joint_params(start)) for one in task.previous)
    state, control = replace(task.state, results=held), replace(task.control, on_iteration=watch)
    simpler = replace(task, model=few, state=state, control=control)
    found = solve_frame(_started(simpler, start)).result
    params = whole(few.solver_params(found.parameters))
    bones, jacobian, _ = model.linearize(params)
    std = found.parameter_std[:6]
    spread = np.diff(model.limits.bounds(joint), axis=1)[:, 0] ** 2 / 12.0  # anywhere between them
    spread[:6] = np.where(np.isfinite(std), std, 1.0) ** 2
    moves = joint_position_jacobian(model, bones, jacobian)
    return Step(
        replace(
            posed_result(model, found, params, max(found.status, Status.DOUBTFUL)),
            parameter_std=np.append(std, np.full(len(joint) - 6, np.inf)),
            joint_covariance=np.einsum("jas,s,jbs->jab", moves, spread, moves),
            energy=found.energy,
            energies=found.energies,
            iterations=found.iterations,
            views=found.views,
        )
    )


# ---- lost fingers

# Shares of the joints' ranges that are tried: base flexion, abduction, and curl of the two joints after.
_FLEX, _SPREAD, _CURL = (0.2, 0.4, 0.6, 0.85), (0.2, 0.5, 0.8), (0.1, 0.4, 0.75)
_ENDS = [(flex, 0.5, curl, curl) for flex, curl in product((0.2, 0.85), (0.1, 0.75))]
"""places of a finger that tell whether anything holds it: as good as all (`free_sign`)"""
_FIXED = 1e3
"""nats that it costs to put a finger elsewhere that cannot go far"""
_WRIST = (0.2, 0.5, 0.8)  # of both of the wrist's, for the forearm
# of a body's shoulder and hip; elbow and knee bend by _CURL
_SWING, _TWIST = (0.15, 0.4, 0.6, 0.85), (0.2, 0.5, 0.8)
_PLACES = 2  # of a finger that may be tried
# of a body's limb, and times as many in all: of 20 made poses 13 were found, 9 as for fingers
_LIMB_PLACES, _LIMBS_MOST = 6, 2
_ELSEWHERE_M = 0.02  # between fingertips, or forearms' ends, and as much further as a body is larger: nearer places lead to the same
SUSPICIOUS_RATIO = 1.4
"""times the usual energy from which a finger may be lost"""
SUSPICIOUS_FRAMES = FEWEST_FRAMES
"""the first frames, in which nothing vouches for any pose"""


@array_dataclass
class FingerObjective:
    """One frame whose pose is nearly known; see engine.Objective."""

    terms: FrameTerms
    """without the pull to the prediction"""
    params: Floats[P]
    """the pose that stands: the bands are frozen there while poses are compared"""
    control: Control

    def measured(self, candidate: Candidate) -> Candidate:
        """Return a candidate with its cost in the narrowest band."""
        model = self.terms.model
        terms = self.terms.visible_at(model.bones(candidate.params))
        seen = terms.stage(model.bones(self.params))
        cost = Problem(model, seen, terms.priors).cost(candidate.params)
        return replace(candidate, cost=cost)

    def distinct(self, candidates: Sequence[Candidate], most: int) -> list[Candidate]:
        return sorted(candidates, key=lambda c: c.cost)[:most]


def finger_shift(
    objective: FingerObjective, found: Sequence[Candidate], most: int
) -> list[Candidate]:
    """Propose all fingers shifted by one in either direction, with their own flexion and with their neighbours'."""
    (standing,) = found
    shifted = finger_shifts(standing.model, standing.params)
    return [replace(standing, params=x, origin="finger shift", cost=np.inf) for x in shifted]


def finger_shift_as_bent(
    objective: FingerObjective, found: Sequence[Candidate], most: int
) -> list[Candidate]:
    """Propose all fingers shifted by one in either direction, with their own flexion."""
    shifted = finger_shift(objective, found, most)[1::2]
    return [replace(one, origin="finger shift as bent") for one in shifted]


def finger_on_grid(
    objective: FingerObjective, found: Sequence[Candidate], most: int
) -> list[Candidate]:
    """Propose each finger, the forearm, or a body's arms and legs, on a grid over its range; the best in the widest band."""
    (standing,) = found
    far = stage_problem(objective.terms, objective.params, 0)
    return [
        replace(standing, params=x, origin=f"finger grid, {finger}", cost=np.inf)
        for finger, x in finger_grid(far, standing.params, most)
    ]


@each
def frame_schedule(objective: FingerObjective, candidate: Candidate, iterations: int) -> Candidate:
    """Optimise by the frame's schedule of bands; visibility is computed at the candidate."""
    terms = objective.terms.visible_at(candidate.model.bones(candidate.params))
    found = descend(terms, candidate.params, objective.control.should_stop)[0].params
    return objective.measured(replace(candidate, params=found))


LOST_FINGER = Search(
    situation="lost finger, forearm or limb",
    when=(
        f"`tracker.escape`; cost above {SUSPICIOUS_RATIO:g} times the lower quartile of earlier frames (the 1st, 2nd, 4th, 8th … such frame in a row), "
        f"the first {SUSPICIOUS_FRAMES} frames, and every {SEARCH_EVERY}th frame"
    ),
    rounds=(
        Round(((finger_shift, 0), (finger_on_grid, 4)), keep=0, fits=((frame_schedule, 0),)),
    ),
    measure="cost in the narrowest band, without the motion prior",
    margin=2.0,  # [log-likelihood] e² times as probable
    repeats=3,
    again="next triggered frame",
)  # fmt: skip
SHIFTED_FINGERS = Search(
    situation="all fingers shifted by one",
    when="every frame, method `paper2004`",
    rounds=(Round(((finger_shift_as_bent, 0),), keep=0, fits=((frame_schedule, 0),)),),
    measure="as for a lost finger",
    again="next frame",
)


def why_fingers_may_be_lost(
    frame: int, energy: float, views: int, previous: Sequence[FrameResult]
) -> str:
    """Return why lost fingers are looked for in a frame; empty where they are not.

    When it fits worse than usual, of several such frames in a row the first, second, fourth, eighth …, as for a lost hand; in one of the
    first frames, which nothing vouches for; and every so many frames: a finger hidden in a fist may settle wrongly with the usual energy.
    """
    if frame % SEARCH_EVERY == SEARCH_EVERY - 1:
        return f"every {SEARCH_EVERY}th frame"
    if len(previous) < SUSPICIOUS_FRAMES:
        return f"one of the first {SUSPICIOUS_FRAMES} frames"
    ratio = energy_ratio(energy, views, previous)
    if ratio <= SUSPICIOUS_RATIO:
        return ""
    suspicious = energy / max(views, 1) * SUSPICIOUS_RATIO / ratio
    before = takewhile(lambda r: r.energy / max(r.views, 1) > suspicious, reversed(previous))
    row = 1 + len(list(before))
    return f"{ratio:.2f} times the usual cost, frame {row} of a row" if is_due(row) else ""


def is_due(row: int) -> bool:
    """Return whether a search is made in that frame of a row: the first, second, fourth, eighth …"""
    return row & (row - 1) == 0


def with_fingers_recovered(
    terms: FrameTerms,
    params: Floats[P],
    control: Control,
    frame: int,
    why: str,
    search: Search = LOST_FINGER,
) -> Floats[P]:
    """Return solver parameters with lost fingers found; the very same where none was lost."""
    objective = FingerObjective(terms.without_motion(), params, control)
    standing = objective.measured(Candidate(terms.model, params, origin="standing pose"))
    return improved(search, objective, standing, frame, why).params


def finger_grid(far: Problem, params: Floats[P], most: int) -> list[tuple[str, Floats[P]]]:
    """Return the `most` promising starts (P,), the best first: each with one finger, the forearm,
    or a body's arm or leg, named, well away from where it is.

    They may cost more than the pose that stands: put anywhere on a grid, a finger covers little of
    its own silhouette, but the one that is lost loses least where it was. No two of a finger are
    near each other: one of them may lead back.

    Parameters
    ----------
    far
        Sees missed silhouette from afar (the widest band); it ranks the places that a finger is put
        to.
    """
    model = far.model
    elsewhere_m, of_each = _ELSEWHERE_M, _PLACES
    if model.kind == "body":
        elsewhere_m, of_each, most = BODY_BY_HAND * _ELSEWHERE_M, _LIMB_PLACES, _LIMBS_MOST * most
    best: list[tuple[float, str, Floats]] = []
    for part, (end, names, shares) in _placements(model).items():
        starts = list(_placed(model, params, names, shares))
        placed = list(zip(in_parallel(far.cost, starts), starts, strict=True))
        places = [(0.0, params), *sorted(placed, key=lambda pair: pair[0])]
        last = model.skeleton.bone(end)
        tips = np.array([model.bone_ends(model.bones(start))[last] for _, start in places])
        elsewhere = apart(
            range(len(places)),
            lambda a, rest, tips=tips: np.linalg.norm(tips[rest] - tips[a], axis=1) > elsewhere_m,
        )
        best += [(places[n][0], part, places[n][1]) for n in islice(elsewhere, 1, 1 + of_each)]
    return [(part, start) for _, part, start in sorted(best, key=lambda row: row[0])[:most]]


def free_sign(terms: FrameTerms, params: Floats[P]) -> float:
    """Return how much less it costs to put the freest of a hand's fingers elsewhere, open or closed, than the one in the middle: the
    logarithm of a ratio of what each adds in nats, and 1; 0 where all cost alike.

    A finger that nothing shows costs as little elsewhere, however narrow the minimum is that it lies in. What is wrong with all of the hand,
    flesh or masks, moves all five. Joints that a detector saw pull from however far: let go, they would leave every finger free.
    """
    problem, placements = stage_problem(terms.wide(), params), _placements(terms.model)
    model, cost = terms.model, problem.cost(params)
    joints = model.joint_positions(model.bones(params))
    least = []
    for names in (placements[finger][1] for finger in FINGERS if finger in placements):
        places = [
            place
            for place in _placed(model, params, names, _ENDS)
            if np.linalg.norm(model.joint_positions(model.bones(place)) - joints, axis=1).max()
            > FRAME_OFF_M
        ]
        least.append(min(map(problem.cost, places), default=cost + _FIXED) - cost)
    added = np.log1p(np.maximum(least or [0.0], 0.0))
    return float(np.median(added) - added.min())


def finger_shifts(model: ArticulatedModel, params: Floats[P]) -> list[Floats[P]]:
    """Return solver parameters with all fingers shifted by one, either way (2004 paper, section 4): the way out when all are.

    The palm moves sideways by the distance of two knuckles, so that every finger stands where its neighbour was; once with
    the fingers bent as they are, once each as that neighbour is: what was seen there then still has its finger.
    """
    if not {"index_mcp", "middle_mcp"} <= set(model.joint_names):
        return []
    bones = model.bones(params)
    places = model.joint_positions(bones)
    index, middle = (places[model.joint_names.index(name)] for name in ("index_mcp", "middle_mcp"))
    sideways = bones.rotation[0][:, 0] * float(np.linalg.norm(middle - index))
    starts = []
    for side in (-1.0, 1.0):
        joint = model.joint_params(params)
        joint[:3] += side * sideways * (1.0 if model.side == "right" else -1.0)
        for posture in (handed_on(model, joint, side), joint):
            starts.append(model.clipped(model.solver_params(posture)))
    return starts


def handed_on(model: ArticulatedModel, joint: Floats[S], side: float) -> Floats[S]:
    """Return joint parameters in which each finger is bent as its neighbour was; side 1: on the little's side."""
    four = FINGERS[1:] if side > 0 else FINGERS[:0:-1]
    moved = joint.copy()
    for finger, other in pairwise(four):
        for bend in ("mcp_flex", "pip_flex", "dip_flex"):
            at, there = (model.skeleton.parameter(f"{f}_{bend}") for f in (finger, other))
            moved[at] = joint[there]
    return moved


_Shares = Sequence[tuple[float, ...]]


def _placements(model: ArticulatedModel) -> dict[str, tuple[str, list[str], _Shares]]:
    """Return of each part that may be lost its last bone, its parameters, and which shares of their ranges are tried."""
    found: dict[str, tuple[str, list[str], _Shares]] = {}
    bent = [(f, s, c, c) for f, s, c in product(_FLEX, _SPREAD, _CURL)]
    for finger in FINGERS:
        base, *after = ("cmc", "mcp", "ip") if finger == "thumb" else ("mcp", "pip", "dip")
        names = [f"{base}_flex", f"{base}_abd", *(f"{joint}_flex" for joint in after)]
        found[finger] = f"{finger}_distal", [f"{finger}_{name}" for name in names], bent
    found["forearm"] = "forearm", ["wrist_flex", "wrist_abd"], list(product(_WRIST, _WRIST))
    swung, stepped = (
        list(product(_SWING, _SWING, _TWIST, _CURL)),
        list(product(_SWING, _SPREAD, _CURL)),
    )
    for side in ("left", "right"):
        arm = [f"{side}_shoulder_{way}" for way in ("abd", "flex", "twist")]
        found[f"{side} arm"] = f"{side}_hand", [*arm, f"{side}_elbow_flex"], swung
        leg = [f"{side}_hip_flex", f"{side}_hip_abd", f"{side}_knee_flex"]
        found[f"{side} leg"] = f"{side}_foot", leg, stepped
    there = set(model.parameter_names)
    return {part: row for part, row in found.items() if there.issuperset(row[1])}


def _placed(
    model: ArticulatedModel, params: Floats[P], names: list[str], shares: _Shares
) -> Iterator[Floats[P]]:
    """Yield params with one part put everywhere in its range."""
    at = [model.skeleton.parameter(name) for name in names]
    joint = model.joint_params(params)
    low, high = model.limits.bounds(joint)[at].T
    for place in shares:
        trial = joint.copy()
        trial[at] = low + np.array(place) * (high - low)
        yield model.clipped(model.solver_params(trial))
