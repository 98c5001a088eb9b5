"""First poses by joints: of points in space, and a person's size; of joints seen in images, whose flips in depth one camera does not
settle, so that all poses that may be are returned.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from handtrack.arrays import D3, Floats, J, P, S, array_dataclass, indices
from handtrack.errors import HandtrackError, index_of
from handtrack.geometry.rotation import rotation_vector, spread_rotations, turn_between
from handtrack.geometry.triangulation import missed_px
from handtrack.geometry.triangulation import triangulated as lines_meet
from handtrack.model.articulated import ArticulatedModel, HandScale, keypoint_names
from handtrack.model.pose_library import named_pose
from handtrack.model.size import SizeParameters
from handtrack.observation.observation import ImageKeypoints, Keypoints
from handtrack.sampling.chains import chains_of
from handtrack.sampling.interpretation_tree import chain_flips
from handtrack.sampling.polish import polish
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.loss import geman_mcclure
from handtrack.tracking.frame.control import Control, Round, Search
from handtrack.tracking.frame.terms.priors import POINTS_REST_RAD, points_rest, pose_priors
from handtrack.tracking.search.engine import Candidate, differing, run_rounds
from handtrack.tracking.search.start_confidence import model_length
from handtrack.tracking.size.estimate import fit_size

FEWEST = 4
"""joints that are known; fewer leave the hand's place open"""


def fit_keypoints(model: ArticulatedModel, seen: Keypoints) -> Floats[P]:
    """Return solver parameters of the hand fitted to points in space, within limits.

    Starts from the relaxed hand, laid rigidly on the points; a weak pull to that pose settles what the
    points leave open. Raises HandtrackError when too few points are known.
    """
    known = np.isfinite(seen.positions).all(axis=1)
    if known.sum() < FEWEST:
        raise HandtrackError(
            f"first-frame pose: {int(known.sum())} keypoints are known, at least {FEWEST} are needed to "
            "place the hand. Add points, or pose the hand by parameters."
        )
    problem = _on_points(model, seen)
    settings = SolverSettings(iterations=60, damping=1e-3)
    starts = [placed_on_points(model, seen, posture) for posture in (model.rest, 3.0 * model.rest)]
    return min((solve(problem, s, settings) for s in starts), key=lambda s: s.cost).params


def placed_on_points(model: ArticulatedModel, seen: Keypoints, posture: Floats[S]) -> Floats[P]:
    """Return solver parameters of a posture moved rigidly onto the points (Kabsch)."""
    joint = posture.copy()
    joint[:6] = 0.0
    joint = np.clip(joint, model.limits.interval[:, 0], model.limits.interval[:, 1])
    bones = model.bones(model.solver_params(joint))
    known = np.isfinite(seen.positions).all(axis=1)
    source = model.joint_positions(bones)[indices(model.joint_names, seen.names)][known]
    target = seen.positions[known]
    turn = turn_between(source - source.mean(axis=0), target - target.mean(axis=0))
    joint[3:6] = rotation_vector(turn)
    joint[:3] = target.mean(axis=0) - turn @ source.mean(axis=0)
    return model.solver_params(joint)


def carried_over(source: ArticulatedModel, params: Floats[P], model: ArticulatedModel) -> Floats[P]:
    """Return solver parameters of `model` with all joint parameters that it shares with `source` by name.

    The others are at rest. Models of hands have the same root frame, so the palm stays where it is.
    """
    given = dict(zip(source.parameter_names, source.joint_params(params), strict=True))
    joint = [
        given.get(name, rest) for name, rest in zip(model.parameter_names, model.rest, strict=True)
    ]
    return model.clipped(model.solver_params(np.array(joint)))


def fit_scale(build: Callable[[HandScale], ArticulatedModel], seen: Keypoints) -> HandScale:
    """Return a person's hand fitted to points in space, together with its pose.

    Factors are pulled towards an adult's mean by how much adults differ, so that noisy points do
    not make odd hands. One frame's points tell no proportions of a hand: noise would be taken for
    them (`webxr_stereo_768` by its cloud 6.0 mm without, 7.2 with).

    Parameters
    ----------
    build
        Makes the model of a given size.
    """
    model = build(HandScale())
    held = model.proportions.names if model.kind == "hand" else ()
    free = np.array([name not in held for name in SizeParameters(model).names])
    problem = _on_points(model, seen)
    return fit_size([problem], [fit_keypoints(model, seen)], free)[0]


def _on_points(model: ArticulatedModel, seen: Keypoints) -> Problem:
    """Return points in space to be met, with a weak pull to the relaxed hand."""
    return Problem(model, [KeypointTerm(model, seen)], pose_priors(model, POINTS_REST_RAD, 0.0))


# ---- joints in images

_ENOUGH_IN_SPACE = 12 / 21
"""share of the joints on which two cameras agree; fewer leave fingers open, and lines of sight say more"""
_POSTURES = ("open", "rest", "curl", "fist")
_BODY_POSTURES: tuple[dict[str, float], ...] = (
    {},
    {"shoulder_abd": 90.0},
    {"shoulder_abd": 150.0},
    {"hip_flex": 85.0, "knee_flex": 85.0},
)
"""degrees that differ from a person's at ease, left and right: hanging, level and raised arms, seated; turned as the search turns them"""
_ROBUST_SIGMAS = 4.0
_SIMILAR_RAD = 0.15
_ROTATIONS = 300
_NEAREST, _FARTHEST = 0.4, 100.0  # from a camera, in lengths of the hand or body
_LEAST_ANGLE = np.deg2rad(2.0)  # between two lines of sight, for a point in space
# of a line of sight from a point, beyond which it is no view of it: px, of the image
_OFF_PX, _OFF_SHARE = (25.0, 0.04)


def joints_sought(model: ArticulatedModel, seen: Sequence[ImageKeypoints]) -> tuple[str, ...]:
    """Return the joints (J,) that place a model: the 21 of a hand, in OpenPose's order; of a body those that were looked for."""
    if model.has_keypoints21:
        return keypoint_names()
    named = dict.fromkeys(name for one in seen for name in one.names)
    return tuple(name for name in named if name in model.joint_names)


def triangulated(seen: Sequence[ImageKeypoints], names: Sequence[str]) -> Floats[J, D3]:
    """Return the named joints in space, world [m], on which at least two cameras agree; NaN for the others.

    Least squares over the lines of sight; the worst line is dropped while more than two are left and it misses the
    point by far.
    """
    cameras = [one.camera for one in seen]
    if len(cameras) < 2:
        return np.full((len(names), 3), np.nan)
    pixels = np.full((len(seen), len(names), 2), np.nan)
    for view, one in zip(pixels, seen, strict=True):
        rows = [row for row, name in enumerate(names) if name in one.names]
        if rows:
            view[rows] = one.pixels[[one.names.index(names[row]) for row in rows]]
    # detectors err in shares of the image
    allowed = np.array([max(_OFF_PX, _OFF_SHARE * max(camera.size)) for camera in cameras])
    while True:
        points = lines_meet(cameras, pixels, _LEAST_ANGLE)
        off = missed_px(cameras, pixels, points) / allowed[:, None]
        seen_by = np.isfinite(pixels).all(axis=2).sum(axis=0)
        poor = np.flatnonzero(np.nan_to_num(off, nan=0.0).max(axis=0) > 1.0)
        points[poor] = np.nan
        poor = poor[seen_by[poor] > 2]
        if not len(poor):
            return points
        pixels[np.nanargmax(off[:, poor], axis=0), poor] = np.nan


def in_space(
    model: ArticulatedModel, seen: Sequence[ImageKeypoints], sigma_m: float
) -> Keypoints | None:
    """Return the model's joints in space where two cameras or more agree on enough of them to place
    it; else None.

    Parameters
    ----------
    sigma_m
        What they are said to be off by.
    """
    names = joints_sought(model, seen)
    points = triangulated(seen, names)
    if not names or np.isfinite(points).all(axis=1).mean() < _ENOUGH_IN_SPACE:
        return None
    return Keypoints(names, points, sigma_m)


@array_dataclass
class ImageJointObjective:
    """Joints seen in images of one frame; see engine.Objective."""

    model: ArticulatedModel
    keypoints: Sequence[ImageKeypoints]
    control = Control()

    @cached_property
    def most(self) -> ImageKeypoints:
        """The view with most joints: it proposes."""
        return max(self.keypoints, key=_joint_count)

    def distinct(self, candidates: Sequence[Candidate], most: int) -> list[Candidate]:
        return differing(candidates, most, _SIMILAR_RAD)


def rotations_of_four_postures(
    objective: ImageJointObjective, found: Sequence[Candidate], most: int
) -> list[Candidate]:
    """Propose four postures at 300 rotations, positioned by the image joints; those of least reprojection error."""
    pairs = sorted(_placed(objective.model, objective.most), key=lambda pair: pair[1])[:most]
    return [Candidate(objective.model, x, cost, "rotations in four postures") for x, cost in pairs]


def depth_flips_of_best(
    objective: ImageJointObjective, found: Sequence[Candidate], most: int
) -> list[Candidate]:
    """Propose the best poses with one finger's or limb's links flipped in depth along the viewing rays."""
    model, camera = objective.model, objective.most.camera
    return [
        Candidate(model, flip, origin="flips in depth of the best")
        for c in objective.distinct(found, most)
        for chain in chains_of(model)
        for flip in chain_flips(model, c.params, chain, camera, least_rad=-1.0)
    ]


def polish_joints(
    objective: ImageJointObjective, candidates: Sequence[Candidate], iterations: int
) -> list[Candidate]:
    """Optimise all starts at once by the compiled solver for joints."""
    model = objective.model
    starts = np.array([c.params for c in candidates])
    priors, loss = pose_priors(model, points_rest(model)), geman_mcclure(_ROBUST_SIGMAS)
    found = polish(model, starts, objective.keypoints, priors, loss, iterations, 1e-3)
    return [
        replace(c, params=found.params[n], cost=float(found.cost[n]), normal=found.normal[n])
        for n, c in enumerate(candidates)
    ]


IMAGE_JOINTS = Search(
    situation="first pose from image joints alone",
    when="as above; the only search without silhouettes and clouds, and for a body",
    rounds=(
        Round(((rotations_of_four_postures, 48),), fits=((polish_joints, 40),)),
        Round(((depth_flips_of_best, 6),), keep=6, fits=((polish_joints, 40),)),
    ),
    measure="robust reprojection error and priors; weights exp(−cost)",
    most=8,
)


def hands_from_images(model: ArticulatedModel, seen: Sequence[ImageKeypoints]) -> list[Candidate]:
    """Return the hands or bodies (P,) that explain joints seen in one or more undistorted images, the best first.

    Hands in many attitudes and postures where the joints are seen, polished, then each finger or limb of the best flipped
    forwards and backwards along the viewing rays and polished again. Their confidences are shares of exp(−cost).
    Raises HandtrackError where too few joints are seen.
    """
    count = max(map(_joint_count, seen), default=0)
    if count < FEWEST:
        raise HandtrackError(
            f"first-frame pose: {count} joints are seen in one image, at least {FEWEST} are needed to place the {model.kind}. "
            "Add points, or pose the hand by parameters."
        )
    objective = ImageJointObjective(model, seen)
    found = run_rounds(IMAGE_JOINTS, objective, ())
    chosen = [c for c in objective.distinct(found, IMAGE_JOINTS.most) if np.isfinite(c.cost)]
    weight = np.exp([chosen[0].cost - c.cost for c in chosen])
    weight /= weight.sum()
    return [
        replace(c, origin="image joints", confidence=float(w))
        for c, w in zip(chosen, weight, strict=True)
        if c.normal is not None
    ]


def _joint_count(seen: ImageKeypoints) -> int:
    return int(np.isfinite(seen.pixels).all(axis=1).sum())


def _placed(model: ArticulatedModel, seen: ImageKeypoints) -> list[tuple[Floats, float]]:
    """Return starts (P,) before a camera, each with how far off the joints are there (sum of squares) [px²].

    For a turn and a posture, the place is the least squares solution of the projection's equations, which are linear
    in it.
    """
    camera = seen.camera
    known = np.asarray(np.isfinite(seen.pixels).all(axis=1))
    rays = (seen.pixels[known] - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]
    where = f"the keypoints of {model.name}"
    named = [name for name, is_known in zip(seen.names, known, strict=True) if is_known]
    index = [index_of("joint", name, model.joint_names, where) for name in named]
    rotations = spread_rotations(_ROTATIONS)
    near, far = (share * model_length(model) for share in (_NEAREST, _FARTHEST))
    found: list[tuple[Floats, float]] = []
    for joint in _postures(model):
        bones = model.bones(model.solver_params(joint))
        shape = model.joint_positions(bones)[index] - joint[:3]
        turned = np.einsum("ij,rjk,nk->rni", camera.rotation, rotations, shape)
        for rotation, points in zip(rotations, turned, strict=True):
            rows = np.zeros((len(points), 2, 3))
            rows[:, 0, 0] = rows[:, 1, 1] = 1.0
            rows[:, :, 2] = -rays
            right = rays * points[:, 2:] - points[:, :2]
            place = np.linalg.lstsq(rows.reshape(-1, 3), right.ravel(), rcond=None)[0]
            there = points + place
            if not near < np.median(there[:, 2]) < far or there[:, 2].min() < 0.02:
                continue
            off = (there[:, :2] / there[:, 2:] - rays) * np.diag(camera.matrix)[:2]
            joint[3:6] = rotation_vector(rotation)
            joint[:3] = camera.rotation.T @ (place - camera.translation)
            start = model.clipped(model.solver_params(joint))
            found.append((start, float((off**2).sum())))
    if not found:
        raise HandtrackError(
            f"first-frame pose: the joints seen by camera '{camera.name}' cannot be a {model.kind}'s before it. Are they in "
            "pixels of the image as it was taken, in OpenPose's order?"
        )
    return found


def _postures(model: ArticulatedModel) -> list[Floats[S]]:
    """Return joint parameters of the postures that are tried, the root at the world's origin."""
    if model.kind == "hand":
        return [named_pose(model, posture) for posture in _POSTURES]
    postures = []
    for bent in _BODY_POSTURES:
        joint = model.rest.copy()
        for row, name in enumerate(model.parameter_names):
            own = name.partition("_")[2]
            joint[row] = np.deg2rad(bent[own]) if own in bent else joint[row]
        postures.append(joint)
    return postures
