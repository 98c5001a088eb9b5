"""A motion file on a model of ours: size and parameters fitted to its joints, frame by frame; as a result, a session, or a motion to render."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, B, F, Floats, Ints, J, P, array_dataclass, check_shape, indices
from handtrack.capture.calibration.rig_file import rig_json, write_rig
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import CameraRig
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.model_file import load_model, write_scale
from handtrack.observation.observation import Keypoints, Observation
from handtrack.observation.truth import Truth
from handtrack.session import layout
from handtrack.session.session_file import (
    BODY_TRACKING,
    CameraSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    write_session_file,
)
from handtrack.session.tables import write_npz
from handtrack.session.truth import write_truth
from handtrack.simulation.motion_files.clip import MotionClip
from handtrack.simulation.motion_files.read_motion import turned_upright, upright_axis
from handtrack.simulation.simulate import (
    SCALE_FILE,
    CustomMotion,
    simulated_rig,
    write_image_joints,
)
from handtrack.solver.covariance import uncertainty
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.tracking.frame.confidence import BODY_OFF_M, FRAME_OFF_M, assessed_as
from handtrack.tracking.frame.frame_task import posed_result
from handtrack.tracking.frame.result import FrameResult, Status, TrackLabels, TrackResult
from handtrack.tracking.frame.terms.priors import points_rest, pose_priors
from handtrack.tracking.search.keypoint_start import FEWEST, fit_keypoints
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
        off = retarget_errors(model, seen.names, points[None], solved.params[None])
        if poses and np.nanmax(off) > _FAR_M:
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
    joints = indices(model.joint_names, names)
    placed = [model.joint_positions(model.bones(pose))[joints] for pose in params]
    return np.linalg.norm(np.stack(placed) - positions, axis=2)


def _shortest_turn(model: ArticulatedModel, params: Floats) -> Floats:
    """Return params (P,) with the same root turn written as a vector of at most half a turn."""
    joint = model.joint_params(params)
    joint[3:6] = rotation_vector(rotation_matrix(joint[3:6]))
    return model.transform.solver_params(joint)


# ---- A BVH that handtrack wrote, back on its model: by the bones' turns, which joint positions alone leave partly open


_ITERATIONS, _DONE_RAD = 50, 1e-9


def own_params(model: ArticulatedModel, clip: MotionClip, unit_m: float) -> Floats[F, P] | None:
    """Return solver parameters whose bones are turned as a clip's joints, each named by its bone; None for other clips.

    The clip's turns are from the model's zero pose, as `export.motion` writes them; the root's place is the clip's.
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


# ---- What was fitted: as a result, a session, or a motion to render


_CAMERAS, _IMAGE = 2, (640, 480)
_VIEW = 0.36  # of a simulated camera: half its height over its focal length is 0.39


@array_dataclass
class Captured:
    """A motion that was fitted."""

    model: ArticulatedModel
    """in the person's size"""
    clip: MotionClip
    """the file's joints by our names [m]"""
    params: Floats[F, P]

    @property
    def errors_m(self) -> Floats[F, J]:
        """How far each joint is from the file's; NaN where unknown."""
        return retarget_errors(self.model, self.clip.names, self.clip.positions, self.params)


def captured(
    build: Callable[[HandScale], ArticulatedModel],
    clip: MotionClip,
    scale: HandScale | None,
    progress: Callable[[], None],
    posed: Callable[[ArticulatedModel], Floats[F, P] | None],
) -> Captured:
    """Return a clip on a model, in the size of the person unless one is given.

    Parameters
    ----------
    build
        Makes the model of a size.
    posed
        The motion's poses, where they are known.

    Raises
    ------
    HandtrackError
        Where no frame has four joints.
    """
    if not len(clip.positions) or known_joints(clip.positions).max() < FEWEST:
        raise HandtrackError(f"in no frame of the motion {FEWEST} joints are known.")
    model = fitted_model(build, clip.names, clip.positions) if scale is None else build(scale)
    params = posed(model)
    if params is None:
        params = retarget(model, clip.names, clip.positions, progress)
    return Captured(model, clip, params)


def result_of(motion: Captured, name: str) -> TrackResult:
    """Return the motion as a tracked sequence: uncertainties as of joints known to 1 cm, doubtful where a joint is far off."""
    model, clip = motion.model, motion.clip
    labels = TrackLabels.of(
        model,
        session=name,
        fps=clip.fps,
        cameras=rig_json(_rig(clip)),
    )
    errors = motion.errors_m
    return labels.track(
        [_frame(motion, frame, errors[frame]) for frame in range(len(clip.positions))]
    )


def _frame(motion: Captured, frame: int, errors: Floats[J]) -> FrameResult:
    model, clip, params = motion.model, motion.clip, motion.params[frame]
    seen = Keypoints(clip.names, clip.positions[frame], _SIGMA_M)
    problem = body_problem(model, seen)
    system = problem.linearize(params)
    alone = Problem(model, problem.observation_terms).linearize(params)
    _, std, spread = uncertainty(model, params, system.hessian, alone.hessian)
    far = BODY_OFF_M if model.kind == "body" else FRAME_OFF_M
    known = np.isfinite(errors)
    status = Status.DOUBTFUL if errors[known].max(initial=0.0) > far else Status.TRACKED
    if known.sum() < FEWEST:
        status = Status.LOST
    result = posed_result(model, Observation(frame, frame / clip.fps), params, std=std)
    result = replace(result, joint_covariance=spread, energy=system.cost)
    return assessed_as(result, status)


def write_captured(folder: Path, motion: Captured, name: str) -> None:
    """Write a session into an empty folder: the tracked motion, the file's joints as truth, and two
    cameras that see them."""
    model, clip = motion.model, motion.clip
    rig = _rig(clip)
    write_rig(folder / layout.CALIBRATION_FILE, rig)
    write_scale(folder / SCALE_FILE, model.scale)
    rows = np.flatnonzero(known_joints(clip.positions))
    if len(rows):
        truth = Truth(rows, rows / clip.fps, None, clip.names, clip.positions[rows])
        write_truth(folder / layout.TRUTH_FILE, truth)
    kind = write_image_joints(folder, model, rig, clip.names, clip.positions)
    cameras = tuple(
        CameraSettings(c.name, keypoints=f"joints/{c.name}/*.json", keypoint_layout=kind)
        for c in rig
    )
    hand = HandSettings(model.name, model.side, SCALE_FILE)
    tracking = BODY_TRACKING if model.kind == "body" else {}
    recording = RecordingSettings(name, clip.fps)
    write_session_file(
        folder / layout.SESSION_FILE, SessionFile(recording, hand, cameras, tracking=tracking)
    )
    (folder / layout.POSES_FILE).parent.mkdir()
    write_npz(folder / layout.POSES_FILE, result_of(motion, name))


def staged(clip: MotionClip) -> MotionClip:
    """Return a clip upright (+y) about the world's origin, as simulated cameras look at it."""
    axis = upright_axis(clip)
    positions = clip.positions if axis is None else turned_upright(clip.positions, axis)
    return replace(clip, positions=positions - _middle(positions))


def distance_m(positions: Floats[F, J, D3]) -> float:
    """Return how far simulated cameras stand off the origin to see all of a staged clip."""
    return float(np.nanmax(np.linalg.norm(positions, axis=2))) / _VIEW * (1.0 + _VIEW)


def custom_motion(motion: Captured) -> CustomMotion:
    """Return a motion that was staged, to be rendered."""
    joint = np.stack([motion.model.joint_params(params) for params in motion.params])
    return motion.model, joint, distance_m(motion.clip.positions)


def _middle(positions: Floats[F, J, D3]) -> Floats[D3]:
    points = positions.reshape(-1, 3)
    return 0.5 * (np.nanmin(points, axis=0) + np.nanmax(points, axis=0))


def _rig(clip: MotionClip) -> CameraRig:
    """Return two cameras that see all of a clip, upright, in its own axes."""
    axis = upright_axis(clip) or (1, 1.0)
    turn = turned_upright(np.eye(3)[None], axis)[0].T
    middle = _middle(clip.positions)
    rig = simulated_rig(_CAMERAS, _IMAGE, max(distance_m((clip.positions - middle) @ turn.T), 0.3))
    return CameraRig(
        tuple(
            replace(
                c,
                rotation=c.rotation @ turn,
                translation=c.translation - c.rotation @ turn @ middle,
            )
            for c in rig
        )
    )


def model_builder(name: str, side: str) -> Callable[[HandScale], ArticulatedModel]:
    """Return what makes a model, by name or definition, of a size."""
    return lambda scale: load_model(name, side=side, scale=scale)
