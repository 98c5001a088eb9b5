"""A frame searched for a hand of which little is known: rigid hands everywhere descend by silhouettes and cloud.

Candidates descend with wide arms first (12 mm), are compared with short ones (4 mm), and the best are fitted as the
tracker fits. First poses, lost hands and the other hand are looked for so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import product, takewhile

import numpy as np

from handtrack.arrays import D3, Array, Floats, Ints, M, N, P, array_dataclass
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import spread_rotations, turned_by
from handtrack.model.articulated import FINGERS, ArticulatedModel, HandScale
from handtrack.model.pose_library import named_pose
from handtrack.model.size import SizeParameters
from handtrack.observation.observation import Observation
from handtrack.parallel import in_parallel
from handtrack.sampling.chains import chains_of
from handtrack.sampling.interpretation_tree import chain_flips
from handtrack.sampling.suppression import apart, apart_joints
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.tracking.frame.confidence import assess, is_where_joints_are
from handtrack.tracking.frame.control import Control, Round, Search, Tried
from handtrack.tracking.frame.frame_task import FrameTask
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import FrameResult, Status, Step
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.priors import SEARCH_REST_RAD, pose_priors
from handtrack.tracking.search.engine import Candidate, each, improved, report, run_rounds
from handtrack.tracking.search.frame_solve import is_due, solve_frame
from handtrack.tracking.search.scores import (
    CloudScore,
    HandShape,
    SilhouetteScore,
    cloud_score,
    hand_shapes,
    palm_middle,
    shape_of,
    silhouette_score,
)
from handtrack.tracking.search.start_confidence import (
    BASIN_M,
    SIZE_SIGMA,
    fit_quality,
    p_in_basin,
    shares,
)
from handtrack.tracking.size.estimate import fit_size
from handtrack.tracking.size.person import SIZE_BANDS_MM

SearchScore = CloudScore | SilhouetteScore
"""what one kind of observation says about where a hand may be"""
Resize = Callable[[ArticulatedModel, HandScale], ArticulatedModel]
"""makes the same hand in another size"""
WIDE_M, NARROW_M = 0.012, 0.004
_PROMISING_COST = 3.0  # times the least cost, beyond which another position is not worth a descent
_BENDS = 2  # of a pose's fingers that are proposed
_FEW_ROTATIONS, _ROTATIONS = 120, 700
"""to find out where a hand may be, and how it is turned there (25° from the nearest on average)"""
_KEPT_PLACES = 10
_HOPELESS = 0.5  # share of disagreement that need not be known exactly
# times the best disagreement of the first look: no shape beyond it is looked at closely
_PROMISING = 2.0
_LOOKED_AT = 3000
PLACE_M = 0.07
"""palms that are nearer are at one place"""
UNSEEN_EVERY = 5
"""frames between two searches in a row where nothing was seen near the expected position"""
_NEAR_M, _SPEED_M = 0.10, 0.03
"""how far a palm may be from where it was, or from the other hand's, and how much further each frame"""
_APART_RAD, _APART_M = np.deg2rad(24.0), 0.03
_STRETCHED, _BENT = "open", "fist"
_SHAPE_ERRORS = 30.0  # ways in which a hand is not the model: length and girth of fifteen phalanges
_MOST_CAMERAS = 2  # along whose lines of sight fingers are flipped


@array_dataclass
class GlobalObjective:
    """One frame's silhouettes and cloud; see engine.Objective."""

    sources: Sequence[SearchScore]
    observation: Observation
    settings: TrackerSettings
    shapes: Sequence[HandShape] = ()
    """rigid hands that the grid proposes"""
    resize: Resize | None = None
    """makes the hand in another size, where its size is not known"""
    within: tuple[Floats[D3], float] | None = None
    """a point and a distance from it [m] beyond which no palm is looked for"""
    palms: Floats[M, D3] | None = None
    """around which points and pixels count; around each pose's own unless given"""
    control: Control = Control()

    @classmethod
    def of(
        cls, seen: Observation, settings: TrackerSettings, control: Control = Control()
    ) -> GlobalObjective | None:
        """Return what a frame's cloud and silhouettes say, as far as settings use them; None where they say nothing."""
        cloud = seen.cloud if settings.cloud.weight > 0 else None
        scores = (
            cloud_score(cloud.points, seen.cloud_views, settings.tracker.seed) if cloud else None,
            silhouette_score(seen.silhouettes if settings.silhouettes.weight > 0 else ()),
        )
        sources = tuple(score for score in scores if score is not None)
        return cls(sources, seen, settings, control=control) if sources else None

    def standing(self, model: ArticulatedModel, params: Floats[P], origin: str) -> Candidate:
        """Return a pose that is not from a search, measured as what a search finds."""
        shape = shape_of(model, model.joint_params(params), origin)
        return self.measured(Candidate(model, params, origin=origin, shape=shape))

    def measured(self, candidate: Candidate) -> Candidate:
        """Return a candidate with the cost by which finished ones are compared: short arms, the same for all; with its forearm or
        without, whichever explains more. One that nothing shows would speak against the right pose, and for one that lays it over the fingers.
        """
        cost = self.narrow_problem(candidate).cost(candidate.params)
        if candidate.model.has_forearm:
            bare = replace(candidate, model=_without_arm(candidate.model))
            cost = min(cost, self.narrow_problem(bare).cost(candidate.params))
        return replace(candidate, cost=cost)

    def compared(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Return candidates with costs by the same points and pixels, those around any of them: where each counts those around itself
        alone, a hand that is upside down leaves out the fingers that it does not explain, and one elsewhere the hand that is not there.
        """
        palms = np.array([palm_middle(c.model, c.params) for c in candidates])
        similarity = replace(self, palms=palms)
        return [similarity.measured(c) for c in candidates]

    def narrow_problem(self, candidate: Candidate) -> Problem:
        """Return the problem around a pose by which finished ones are compared; of several sizes it favours none."""
        return self.problem(candidate, NARROW_M, unbiased=self.resize is not None)

    def problem(self, candidate: Candidate, band_m: float, unbiased: bool = False) -> Problem:
        shape, model = candidate.rigid, candidate.model
        terms = [
            term
            for source in self.sources
            for term in source.terms(shape, model, candidate.params, band_m, unbiased, self.palms)
        ]
        return Problem(model, terms, pose_priors(model, SEARCH_REST_RAD))

    def independent_errors(self, candidate: Candidate) -> float:
        """Return how many measurements err independently of each other where a pose is.

        Along a phalanx outlines and clouds err alike; and all views of one hand err alike that is not the model's.
        """
        shape = candidate.rigid
        pieces = sum(source.pieces(shape, candidate.params) for source in self.sources)
        return 1.0 / (1.0 / max(pieces, 1.0) + 1.0 / _SHAPE_ERRORS)

    def distinct(self, candidates: Sequence[Candidate], most: int) -> list[Candidate]:
        """Return the best, at most `most`, each pose once.

        No place takes more than half of them while another is promising: the end of an arm fits a fist in many variants,
        each a little better than the hand, whose fingers are not in place yet.
        """
        ordered = sorted(candidates, key=lambda c: c.cost)
        joints = np.array([c.joints for c in ordered])
        rows = list(apart_joints(range(len(ordered)), joints, BASIN_M))
        palms = np.array([palm_middle(c.model, c.params) for c in ordered])
        promising = [n for n in rows if ordered[n].cost <= _PROMISING_COST * ordered[0].cost]
        kept = [*spread_over_places(promising, palms, most), *rows[len(promising) :]]
        return sorted((ordered[n] for n in kept[:most]), key=lambda c: c.cost)


# ---- what proposes


def rigid_grid(
    objective: GlobalObjective, found: Sequence[Candidate], most: int
) -> list[Candidate]:
    """Propose rigid hands on a grid of rotations and positions, sorted by the area outside the overlap.

    The shapes, the best first, at most `most`, none like a better one; at most half of them at one place, if nothing is known of where the
    hand is. A first look with few turns tells at which places a hand may be at all; those are looked at closely. Only the first of the
    sources is asked here: a cloud says more than silhouettes.
    """
    source, shapes, within = objective.sources[0], objective.shapes, objective.within
    should_stop = objective.control.should_stop
    places, few = source.places, spread_rotations(_FEW_ROTATIONS)
    if within is not None:
        places = places[np.linalg.norm(places - within[0], axis=1) < within[1]]
    if not len(places):
        return []
    typical = [shape for shape in shapes if shape.is_typical]
    rough = np.stack(in_parallel(lambda s: source.scores(s, few, places, _HOPELESS), typical))
    places = places[np.argsort(rough.min(axis=(0, 1)), kind="stable")[:_KEPT_PLACES]]
    rotations = spread_rotations(_ROTATIONS)
    enough = _PROMISING * float(rough.min())
    scored = in_parallel(
        lambda s: None if should_stop() else source.scores(s, rotations, places, enough), shapes
    )
    finished = [one for one in scored if one is not None]
    if len(finished) < len(shapes):
        return []
    scores = np.stack(finished)
    order = np.argsort(scores, axis=None, kind="stable")[:_LOOKED_AT]
    s, r, p = np.unravel_index(order, scores.shape)
    posture = np.array([shape.posture for shape in shapes])[s]
    turn, place = rotations[r], places[p]

    def is_far(a: int, rest: Ints) -> Array:
        away = np.linalg.norm(place[rest] - place[a], axis=1) >= _APART_M
        turned = turned_by(turn[rest], turn[a]) >= _APART_RAD
        return (posture[rest] != posture[a]) | away | turned

    share = 0.5 if within is None else 1.0  # around a known place there is but one
    rows = spread_over_places(apart(range(len(order)), is_far), place, most, share)
    kept = [
        Candidate(
            shapes[s[n]].model,
            shapes[s[n]].params_at(turn[n], place[n]),
            float(scores[s[n], r[n], p[n]]),
            f"rigid grid, {posture[n]}",
            shapes[s[n]],
        )
        for n in rows
    ]
    return sorted(kept, key=lambda candidate: candidate.cost)


def rigid_grid_nearby(
    objective: GlobalObjective, found: Sequence[Candidate], most: int
) -> list[Candidate]:
    """Propose rigid hands on a grid around the last position; none is rejected before its fit."""
    return [replace(c, cost=0.0) for c in rigid_grid(objective, found, most)]


def current_pose(
    objective: GlobalObjective, found: Sequence[Candidate], most: int
) -> list[Candidate]:
    """Propose the current estimate."""
    return [replace(c, cost=0.0) for c in _best(found)]


def depth_flips(
    objective: GlobalObjective, found: Sequence[Candidate], most: int
) -> list[Candidate]:
    """Propose the best pose with one finger flipped in depth, seen from one of the first cameras."""
    cameras = [silhouette.camera for silhouette in objective.observation.silhouettes]
    return [
        replace(best, params=x, origin="depth flips", cost=0.0)
        for best in _best(found)
        for x in flipped_fingers(best.model, cameras, best.params)
    ]


def finger_bends(
    objective: GlobalObjective, found: Sequence[Candidate], most: int
) -> list[Candidate]:
    """Propose each pose with all 16 combinations of extended and flexed fingers; the best two per pose."""
    bent: list[Candidate] = []
    for candidate in objective.distinct(found, len(found)):
        problem = objective.problem(candidate, WIDE_M)
        tried = [
            replace(
                candidate,
                params=x,
                cost=problem.cost(x),
                origin=f"{candidate.origin}, fingers bent otherwise",
            )
            for x in bent_fingers(candidate.model, candidate.params)
        ]
        bent += sorted(tried, key=lambda c: c.cost)[:_BENDS]
    return objective.distinct(bent, most)


def best_pose(objective: GlobalObjective, found: Sequence[Candidate], most: int) -> list[Candidate]:
    """Propose the best pose once more, if the search for lost fingers is on."""
    best = _best(found) if objective.settings.tracker.escape else []
    return [replace(c, origin=f"{c.origin}, fingers looked for") for c in best]


def best_poses(
    objective: GlobalObjective, found: Sequence[Candidate], most: int
) -> list[Candidate]:
    """Propose the best poses once more, if the hand's size is unknown."""
    return objective.distinct(found, most) if objective.resize else []


def _best(found: Sequence[Candidate]) -> list[Candidate]:
    return [min(found, key=lambda c: c.cost)] if found else []


# ---- what fits


@each
def wide(objective: GlobalObjective, candidate: Candidate, iterations: int) -> Candidate:
    """Optimise with a band of 12 mm on subsampled points and pixels."""
    moved = _descended(objective, candidate, WIDE_M, iterations)
    return replace(moved, cost=objective.problem(moved, WIDE_M).cost(moved.params))


@each
def narrow(objective: GlobalObjective, candidate: Candidate, iterations: int) -> Candidate:
    """Optimise with a band of 4 mm."""
    return objective.measured(_descended(objective, candidate, NARROW_M, iterations))


@each
def size(objective: GlobalObjective, candidate: Candidate, iterations: int) -> Candidate:
    """Optimise pose and overall size.

    The parts keep their shares: one frame, seen with a pose still wrong, would blame a bent finger on its length. What is
    looked at stays the same, so that costs can be compared.
    """
    assert objective.resize is not None, "nothing is proposed where the size is known"
    for band_m in (WIDE_M, *(1e-3 * mm for mm in SIZE_BANDS_MM)):
        model, before = candidate.model, candidate.rigid
        free = np.array([name == "overall" for name in SizeParameters(model).names])
        problem = objective.problem(candidate, band_m, unbiased=band_m != WIDE_M)
        scale, (params,) = fit_size([problem], [candidate.params], free)
        model = objective.resize(model, scale)
        shape = shape_of(model, model.joint_params(params), before.posture)
        shape = replace(shape, reach=before.reach)
        candidate = replace(candidate, model=model, shape=shape, params=params)
    origin = f"{candidate.origin}, of another size"
    return objective.measured(replace(candidate, origin=origin))


@each
def tracker(objective: GlobalObjective, candidate: Candidate, iterations: int) -> Candidate:
    """Solve the frame as in tracking."""
    return _solved(objective, candidate, {"tracker.escape": False})


@each
def tracker_with_lost_fingers(
    objective: GlobalObjective, candidate: Candidate, iterations: int
) -> Candidate:
    """Solve the frame as in tracking, with the search for lost fingers."""
    return _solved(objective, candidate, {})


def _descended(
    objective: GlobalObjective, candidate: Candidate, band_m: float, iterations: int
) -> Candidate:
    settings = SolverSettings(iterations=iterations)
    found = solve(objective.problem(candidate, band_m), candidate.params, settings)
    return replace(candidate, params=found.params)


def _solved(objective: GlobalObjective, candidate: Candidate, own: Mapping[str, bool]) -> Candidate:
    """Return a candidate where the tracker, by settings of its own, fits the frame from there, by what is seen alone."""
    settings = objective.settings.with_values({"tracker.hypotheses": 1, **own})
    model, control = candidate.model, replace(objective.control, on_iteration=None)
    start = model.clipped(candidate.params)
    solved = solve_frame(FrameTask(model, settings, objective.observation, start, control=control))
    params = model.solver_params(solved.result.parameters)
    return objective.measured(replace(candidate, params=params, solved=solved))


@lru_cache(maxsize=8)
def _without_arm(model: ArticulatedModel) -> ArticulatedModel:
    """Return the model with a forearm that covers nothing."""
    ellipsoids = {n: one.subset(~model.is_forearm(one.bone)) for n, one in model.ellipsoids.items()}
    return replace(model, ellipsoids=ellipsoids)


# ---- fingers put elsewhere


def spread_over_places(
    rows: Iterable[int], places: Floats[N, D3], most: int, share: float = 0.5
) -> list[int]:
    """Return at most `most` of the rows, the best first: no place takes more than a share of them
    while others are left.

    Parameters
    ----------
    places
        (N, 3) of a palm's middle, for each row [m].
    """
    chosen: list[int] = []
    spare: list[int] = []
    for row in rows:
        here = (np.linalg.norm(places[chosen] - places[row], axis=1) < PLACE_M).sum()
        (chosen if here < share * most else spare).append(row)
        if len(chosen) == most:
            break
    return [*chosen, *spare][:most]


def bent_fingers(model: ArticulatedModel, params: Floats[P]) -> list[Floats[P]]:
    """Return solver parameters of a pose with each finger but the thumb stretched or bent: 16 poses."""
    ends = [named_pose(model, name) for name in (_STRETCHED, _BENT)]
    bends = [
        [model.skeleton.parameter(f"{finger}_{joint}_flex") for joint in ("mcp", "pip", "dip")]
        for finger in FINGERS[1:]
    ]
    poses = []
    for way in product(ends, repeat=len(bends)):
        joint = model.joint_params(params)
        for at, end in zip(bends, way, strict=True):
            joint[at] = end[at]
        poses.append(model.clipped(model.solver_params(joint)))
    return poses


def flipped_fingers(
    model: ArticulatedModel, cameras: Sequence[Camera], params: Floats[P]
) -> list[Floats[P]]:
    """Return solver parameters with one finger's links flipped along the lines of sight of one of the first cameras.

    The 2003 paper's kinematic jumps, on a hand's chains; only flips that limits allow, and that move the finger at all.
    """
    return [
        flip
        for camera in cameras[:_MOST_CAMERAS]
        for chain in chains_of(model)
        for flip in chain_flips(model, params, chain, camera)
    ]


# ---- policies


LOST_HAND = Search(
    situation="lost hand",
    when=(
        "low confidence or lost (`tracker.recovery`); not where only the uncertainty is large, the cloud is poor or holds other objects, "
        "or masks cover more than half of an image"
    ),
    rounds=(
        Round(
            ((rigid_grid_nearby, 28), (current_pose, 0), (depth_flips, 0)),
            keep=0,
            enter=60,
            fits=((wide, 8),),
        ),
        Round(enter=10, fits=((wide, 12),)),
        Round(enter=3, fits=((tracker, 0),)),
        Round(((best_pose, 0),), adds=True, fits=((tracker_with_lost_fingers, 0),)),
    ),
    measure="observation cost in the narrow band (4 mm)",
    factor=0.95,
    again=(
        "the 1st, 2nd, 4th, 8th … such frame in a row; without observations also every "
        f"{UNSEEN_EVERY}th"
    ),
)
FINISH = (
    Round(enter=5, fits=((tracker, 0),)),
    Round(((best_pose, 0),), adds=True, fits=((tracker_with_lost_fingers, 0),)),
)
"""how first poses are finished, wherever they come from"""
FIRST_POSE = Search(
    situation="no first pose",
    when="`--init auto`, *Detect hand*",
    rounds=(
        Round(((rigid_grid, 48),), enter=48, fits=((wide, 10),)),
        Round(((finger_bends, 12),), keep=12, fits=((wide, 12),)),
        Round(enter=24, fits=((narrow, 8),)),
        Round(((best_poses, 5),), adds=True, fits=((size, 0),)),
        *FINISH,
        Round(((best_poses, 1),), adds=True, fits=((size, 0), (tracker, 0))),
    ),
    measure="observation cost in the narrow band (4 mm); sorted by confidence",
    most=5,
)
GIVEN_JOINTS = Search(
    situation="first pose from image joints, with silhouettes or a cloud",
    when="fewer than 12 of 21 joints are consistent in two cameras",
    rounds=FINISH,
    measure="as for a first pose",
    most=FIRST_POSE.most,
)
OTHER_SIDE = Search(
    situation="left or right hand",
    when=(
        "after tracking from a detected first pose, or one without joints; in up to 4 frames, until the tracked side fits better"
    ),
    rounds=(
        Round(((rigid_grid_nearby, 28),), keep=0, enter=28, fits=((wide, 8),)),
        Round(enter=10, fits=((wide, 12),)),
        Round(enter=3, fits=((tracker_with_lost_fingers, 0),)),
    ),
    measure="as for a first pose",
    taken="none; a warning if the summed log-odds exceed 5",
)


# ---- the first frame without a first pose: hands everywhere, the best descend, the rest is told apart by energy


Progress = Callable[[float, str], None]
"""called with the share that is done and what is being done"""


def auto_start(
    models: Sequence[ArticulatedModel],
    settings: TrackerSettings,
    seen: Observation,
    should_stop: Callable[[], bool] | None = None,
    on_progress: Progress | None = None,
    size_sigma: float = SIZE_SIGMA,
    resize: Resize | None = None,
    found: Sequence[Candidate] = (),
) -> list[Candidate]:
    """Return first poses for what was seen of one frame, the surest first; empty where no hand can be seen.

    Looks everywhere: nothing is assumed of position, rotation and posture but that the hand is rather open than closed.

    Parameters
    ----------
    models
        those that may explain it, say without and with a forearm
    size_sigma
        the share to which their size is known
    resize
        makes them in other sizes, where it is not; the best poses then find theirs
    found
        poses by joints in images, of which silhouettes and cloud decide instead of a search over `models`
    """
    progress = on_progress or (lambda share, text: None)
    search = GIVEN_JOINTS if found else FIRST_POSE
    control = Control() if should_stop is None else Control(should_stop)
    progress(0.0, "looking for the hand")
    count = len(search.rounds)
    objective = GlobalObjective.of(seen, settings, control)
    if objective is None:
        return []
    shapes = [shape for model in models for shape in hand_shapes(model)]
    objective = replace(objective, shapes=shapes, resize=resize)
    done = run_rounds(
        search, objective, found, lambda n, tried: progress(n / count, f"{tried} poses are tried")
    )
    kept = objective.distinct([c for c in done if c.solved is not None], search.most)
    if not kept:
        return []
    kept = sorted(objective.compared(kept), key=lambda c: c.cost)
    quality = fit_quality(kept[0].model, settings, seen, kept[0].params)
    errors = objective.independent_errors(kept[0])
    share = shares(np.array([c.cost for c in kept]), errors)
    sure = []
    for candidate, part in zip(kept, share, strict=True):
        problem = objective.narrow_problem(candidate)
        given = [KeypointTerm(candidate.model, joints) for joints in seen.keypoints]
        problem = replace(problem, observation_terms=[*problem.observation_terms, *given])
        near = p_in_basin(problem, candidate.params, errors, size_sigma, settings.tracker.seed)
        sure.append(replace(candidate, confidence=float(quality * part * near), p_in_basin=near))
    return sure


# ---- a hand that may be lost: hands around the last known place are tried, and taken only where they fit clearly better


def why_hand_may_be_lost(result: FrameResult, previous: Sequence[FrameResult]) -> str:
    """Return why the hand is looked for elsewhere; empty where it is not.

    When a frame does not fit; of several such frames in a row the first, second, fourth, eighth …: what was not found in
    one of them is rarely found in the next. A frame in which nothing was seen ends such a row and begins one of its own
    (there may be a cloud, but far from where the hand was expected), of which every fifth is looked at as well. Among the wrong points
    of a poor cloud, and among those of other things, another hand often fits better: there nothing is looked for while the hand is not lost.
    """
    if result.fits or not previous or result.clutters:
        return ""
    unseen, row = not np.isfinite(result.energy), 1
    for before in reversed(previous):
        if before.fits or not (unseen or np.isfinite(before.energy)):
            break
        row += 1
    due = is_due(row) or (unseen and row % UNSEEN_EVERY == 0)
    return f"frame {row} of a series without a good fit: {result.note}" if due else ""


def searches_everywhere(previous: Sequence[FrameResult]) -> bool:
    """Return whether the next frame is one in which a lost hand is looked for everywhere; in others it is where it was, or nowhere."""
    row = 1 + len(list(takewhile(lambda r: not r.fits, reversed(previous))))
    lost = bool(previous) and previous[-1].status == Status.LOST
    return lost and (is_due(row) or row % UNSEEN_EVERY == 0)


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
    objective = GlobalObjective.of(task.observation, task.settings, task.control)
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

    standing = objective.standing(model, params, "standing pose")
    best = improved(LOST_HAND, objective, standing, task.observation.frame, why, compared)
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


# ---- the other hand: a left and a right one, looked for at the same place, are told apart by how well they fit


def other_side_log_odds(
    model: ArticulatedModel,
    other: ArticulatedModel,
    settings: TrackerSettings,
    observations: Iterable[tuple[Observation, Floats[P]]],
    control: Control = Control(),
) -> float:
    """Return the log-odds that the hand is the other one; below 0, and looking ends, once this one
    explains more.

    The other hand is looked for around it; where it fits better, this one is looked for likewise,
    so that a poor pose of the right hand does not speak against it.

    Parameters
    ----------
    observations
        What was seen of some frames, and this hand's pose there.
    """
    total = 0.0
    for seen, params in observations:
        objective = GlobalObjective.of(seen, settings, control)
        if objective is None:
            continue
        ours = objective.standing(model, params, "tracked")
        count = objective.independent_errors(ours)
        objective = replace(objective, within=(palm_middle(model, params), _NEAR_M))
        theirs = _candidates_of(other, objective, ours.cost)
        least, best = _least_of_each(objective, [ours], theirs)
        if best < least:
            this = [ours, *_candidates_of(model, objective, best)]
            least, best = _least_of_each(objective, this, theirs)
        if control.should_stop():
            return 0.0
        if 0 < least < np.inf and 0 < best < np.inf:  # else nothing of it was seen
            total += 0.5 * count * float(np.log(least / best))
        if total < 0:
            break
    return total


def _least_of_each(
    objective: GlobalObjective, this: Sequence[Candidate], other: Sequence[Candidate]
) -> tuple[float, float]:
    """Return the least cost of this hand's poses and of the other's, by the same pixels."""
    costs = [c.cost for c in objective.compared([*this, *other])]
    return min(costs[: len(this)]), min(costs[len(this) :], default=np.inf)


def _candidates_of(
    hand: ArticulatedModel, objective: GlobalObjective, standing: float
) -> list[Candidate]:
    """Return poses at which a hand was found."""
    objective, tried = replace(objective, shapes=hand_shapes(hand)), Tried()
    found = run_rounds(OTHER_SIDE, objective, [], tried=tried)
    best = min(found, key=lambda c: c.cost, default=None)
    why = f"is it a {hand.side} hand?"
    report(OTHER_SIDE, objective.control, objective.observation.frame, why, tried, best, standing)
    return found
