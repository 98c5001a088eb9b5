"""A motion file on a model of ours: names, unit and size settled, every frame fitted; as a result, a session, or a motion to render."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, F, Floats, J, P, array_dataclass
from handtrack.capture.calibration.rig_file import rig_json, write_rig
from handtrack.capture.images.openpose import LAYOUTS
from handtrack.capture.joints.given_joints import write_joints
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import CameraRig
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.model_file import load_model, scale_table, write_scale
from handtrack.observation.observation import Keypoints, Observation
from handtrack.observation.truth import Truth
from handtrack.session import layout
from handtrack.session.formats.tables import write_npz
from handtrack.session.formats.truth import write_truth
from handtrack.session.session_file import (
    BODY_TRACKING,
    CameraSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    write_session_file,
)
from handtrack.simulation.motion_files.clip import MotionClip
from handtrack.simulation.motion_files.read_motion import turned_upright, upright_axis
from handtrack.simulation.retarget import (
    body_problem,
    fitted_model,
    known_joints,
    retarget,
    retarget_errors,
)
from handtrack.simulation.simulate import (
    SCALE_FILE,
    CustomMotion,
    layout_of_model,
    points_of,
    simulated_rig,
)
from handtrack.solver.covariance import uncertainty
from handtrack.solver.problem import Problem
from handtrack.tracking.frame.confidence import BODY_OFF_M, FRAME_OFF_M, assessed_as
from handtrack.tracking.frame.frame_task import posed_result
from handtrack.tracking.frame.result import FrameResult, Status, TrackLabels, TrackResult
from handtrack.tracking.search.initialize import FEWEST

_CAMERAS, _SIZE = 2, (640, 480)
_SIGMA_M = 0.01  # as `retarget` has it
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
        scale=json.dumps(scale_table(model.scale)),
        session=name,
        definition=model.definition,
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
    kind = layout_of_model(model)
    for camera in rig:
        seen = {
            frame: points_of(LAYOUTS[kind], clip.names, camera.project(points))
            for frame, points in enumerate(clip.positions)
        }
        write_joints(seen, kind, folder / "joints" / camera.name)
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


def custom_motion(motion: Captured, name: str) -> CustomMotion:
    """Return a motion that was staged, to be rendered."""
    joint = np.stack([motion.model.joint_params(params) for params in motion.params])
    return CustomMotion(name, motion.model, joint, distance_m(motion.clip.positions))


def _middle(positions: Floats[F, J, D3]) -> Floats[D3]:
    points = positions.reshape(-1, 3)
    return 0.5 * (np.nanmin(points, axis=0) + np.nanmax(points, axis=0))


def _rig(clip: MotionClip) -> CameraRig:
    """Return two cameras that see all of a clip, upright, in its own axes."""
    axis = upright_axis(clip) or (1, 1.0)
    turn = turned_upright(np.eye(3)[None], axis)[0].T
    middle = _middle(clip.positions)
    rig = simulated_rig(_CAMERAS, _SIZE, max(distance_m((clip.positions - middle) @ turn.T), 0.3))
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
