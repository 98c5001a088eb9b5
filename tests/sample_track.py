"""Small tracked sequences of invented poses."""

import json
from collections.abc import Iterable
from typing import Any

import numpy as np

from handtrack import ArticulatedModel, FrameResult, Status, TrackResult, load_model
from handtrack.arrays import Floats
from handtrack.model.model_file import scale_table
from handtrack.tracking.frame.result import TrackLabels

HAND = load_model("hand26")


def sample_frame(rng: np.random.Generator, frame: int, **more: Any) -> FrameResult:
    """Return a tracked frame of a hand in any pose; more: other fields."""
    pose = HAND.clipped(rng.uniform(-0.1, 1.0, len(HAND.rest)))
    return posed_frame(HAND, frame, pose, **more)


def stacked(frames: Iterable[FrameResult]) -> TrackResult:
    return labels_of(HAND).track(list(frames))


def sample_track(rng: np.random.Generator, frames: Iterable[int] = range(5)) -> TrackResult:
    return stacked(sample_frame(rng, frame) for frame in frames)


def posed_frame(
    model: ArticulatedModel, frame: int, values: Floats, fps: float = 25.0, **more: Any
) -> FrameResult:
    """Return a tracked frame of a model's joint parameters (S,), each known to 0.01 and every joint to 2 mm; more: other fields."""
    bones = model.bones(model.transform.solver_params(values))
    joints = model.joint_positions(bones)
    known = {
        "status": Status.TRACKED, "energy": 1.0, "iterations": 4, "parameter_std": np.full(len(values), 0.01),
        "joint_covariance": np.tile(0.002**2 * np.eye(3), (len(joints), 1, 1)),
        "keypoints21": model.keypoints21(bones) if model.has_keypoints21 else None,
    }  # fmt: skip
    return FrameResult(
        frame=frame, time_s=frame / fps, parameters=values, T_world_bone=bones.T_world_bone, joint_positions=joints,
        **known | more,
    )  # fmt: skip


def labels_of(model: ArticulatedModel, session: str = "invented", **more: Any) -> TrackLabels:
    return TrackLabels(
        model.parameter_names, model.skeleton.bone_names, model.joint_names, model.name, model.side,
        json.dumps(scale_table(model.scale)), session, "{}", "0.0", **more,
    )  # fmt: skip


def hand_track(count: int = 5) -> TrackResult:
    """Return a right hand that closes and moves along x."""
    frames = []
    for frame in range(count):
        joint = (0.5 + frame / count) * HAND.rest
        joint[0] = 0.01 * frame
        frames.append(posed_frame(HAND, frame, HAND.clipped(joint)))
    return stacked(frames)
