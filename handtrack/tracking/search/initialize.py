"""First frame: a pose, and a person's hand size, from keypoints."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from handtrack.arrays import Floats, P, S, indices
from handtrack.errors import HandtrackError
from handtrack.geometry.rotation import rotation_vector, turn_between
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.size import SizeParameters
from handtrack.observation.observation import Keypoints
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.tracking.frame.terms.priors import POINTS_REST_RAD, pose_priors
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
