"""Fit body34's size and parameters to another skeleton's joint positions over time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from handtrack.arrays import D3, B, F, Floats, Ints, J, P, check_shape, indices
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.observation.observation import Keypoints
from handtrack.simulation.motion_files.clip import MotionClip
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.tracking.frame.terms.priors import points_rest, pose_priors
from handtrack.tracking.search.initialize import FEWEST, fit_keypoints
from handtrack.tracking.size.estimate import fit_size

_SIGMA_M = 0.01  # how well another skeleton's joints are ours
_SIZE_FRAMES = 24  # spread over the clip, to fit the person's size
_SOLVER = SolverSettings(iterations=30, damping=1e-3)
_FAR_M = 0.03  # an error of one joint beyond which a frame is started afresh as well


def retarget(
    model: ArticulatedModel,
    names: tuple[str, ...],
    positions: Floats[F, J, D3],
    progress: Callable[[], None] = lambda: None,
) -> Floats[F, P]:
    """Return solver parameters whose joints are nearest to positions world [m], within limits.

    Parameters
    ----------
    names
        (J,) joints of the model; unknown places are NaN. Each frame starts from the one before it,
        and afresh where that leads far off; one in which fewer than four joints are known keeps the
        pose before it. The model's size stays: `fitted_model` finds a person's.
    progress
        Called after each frame.

    Raises
    ------
    HandtrackError
        Where no frame has four.
    """
    check_shape(positions, (None, len(names), 3), "positions to retarget")
    enough = known_joints(positions) >= FEWEST
    first = int(np.argmax(enough))
    poses: list[Floats] = []
    for frame, points in enumerate(positions):
        progress()
        if not enough[frame]:
            if poses:
                poses.append(poses[-1])
                continue
            points = positions[first]
        seen = Keypoints(tuple(names), points, _SIGMA_M)
        start = poses[-1] if poses else fit_keypoints(model, seen)
        solved = solve(body_problem(model, seen), start, _SOLVER)
        if poses and np.nanmax(_errors(model, seen, solved.params)) > _FAR_M:
            afresh = solve(body_problem(model, seen), fit_keypoints(model, seen), _SOLVER)
            solved = min(solved, afresh, key=lambda summary: summary.cost)
        poses.append(_shortest_turn(model, solved.params))
    return np.array(poses).reshape(len(positions), -1)


def fitted_model(
    build: Callable[[HandScale], ArticulatedModel],
    names: tuple[str, ...],
    positions: Floats[F, J, D3],
) -> ArticulatedModel:
    """Return the model in the size of the person whose joints are at positions world [m].

    Parameters
    ----------
    build
        Makes the model of a given size.
    """
    check_shape(positions, (None, len(names), 3), "positions to fit a body to")
    positions = positions[known_joints(positions) >= FEWEST]
    chosen = np.unique(np.linspace(0, len(positions) - 1, _SIZE_FRAMES).astype(int))
    seen = [Keypoints(tuple(names), positions[i], _SIGMA_M) for i in chosen]
    mean = build(HandScale())
    starts = [fit_keypoints(mean, points) for points in seen]
    return build(fit_size([body_problem(mean, points) for points in seen], starts)[0])


def known_joints(positions: Floats[F, J, D3]) -> Ints[F]:
    """Return how many joints of each frame are known."""
    return np.asarray(np.isfinite(positions).all(axis=2).sum(axis=1))


def body_problem(model: ArticulatedModel, seen: Keypoints) -> Problem:
    """Return joints to be met, with a weak pull to rest that settles what they leave open; nothing keeps parts apart."""
    return Problem(model, [KeypointTerm(model, seen)], pose_priors(model, points_rest(model), 0.0))


def retarget_errors(
    model: ArticulatedModel,
    names: tuple[str, ...],
    positions: Floats[F, J, D3],
    params: Floats[F, P],
) -> Floats[F, J]:
    """Return how far the model's joints are from positions [m]; NaN where unknown."""
    pairs = zip(positions, params, strict=True)
    return np.stack(
        [_errors(model, Keypoints(tuple(names), points, _SIGMA_M), pose) for points, pose in pairs]
    )


def _shortest_turn(model: ArticulatedModel, params: Floats) -> Floats:
    """Return params (P,) with the same root turn written as a vector of at most half a turn."""
    joint = model.joint_params(params)
    joint[3:6] = rotation_vector(rotation_matrix(joint[3:6]))
    return model.transform.solver_params(joint)


def _errors(model: ArticulatedModel, seen: Keypoints, params: Floats) -> Floats:
    joints = indices(model.joint_names, seen.names)
    placed = model.joint_positions(model.bones(params))[joints]
    return np.linalg.norm(placed - seen.positions, axis=1)


# ---- A BVH that handtrack wrote, back on its model: by the bones' turns, which joint positions alone leave partly open


_ITERATIONS, _DONE_RAD = 50, 1e-9


def own_params(model: ArticulatedModel, clip: MotionClip, unit_m: float) -> Floats[F, P] | None:
    """Return solver parameters whose bones are turned as a clip's joints, each named by its bone; None for other clips.

    The clip's turns are from the model's zero pose, as `export.motion.bvh` writes them; the root's place is the clip's.
    """
    names = ["_".join(name.split()) for name in model.skeleton.bone_names]
    if clip.turns is None or not set(names) <= set(clip.names):
        return None
    columns = indices(clip.names, names)
    rest = model.bones(model.params_from({})).rotation
    wanted = clip.turns[:, columns] @ rest
    places = clip.positions[:, columns[0]] * unit_m
    params = model.rest_params()
    found = []
    for turns, place in zip(wanted, places, strict=True):
        params = _turned(model, turns, params)
        joint = model.joint_params(params)
        joint[:3] = place
        joint[3:6] = rotation_vector(rotation_matrix(joint[3:6]))
        params = model.transform.solver_params(joint)
        found.append(params)
    return np.array(found)


def _turned(model: ArticulatedModel, wanted: Floats[B, D3, D3], params: Floats[P]) -> Floats[P]:
    """Return solver parameters of bones' turns, by Gauss and Newton."""
    for _ in range(_ITERATIONS):
        bones, twists, _ = model.linearize(params)
        off = rotation_vector(wanted @ np.swapaxes(bones.rotation, 1, 2))
        turns = (twists[:, 3:] @ model.transform.matrix).reshape(-1, len(params))
        step = np.linalg.lstsq(turns, off.ravel(), rcond=None)[0]
        params = params + step
        if np.abs(step).max() < _DONE_RAD:
            break
    return params
