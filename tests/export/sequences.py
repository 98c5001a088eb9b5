"""Tracked sequences whose poses are those of a model: hands of both sides, a body, a claw that a user defined."""

from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

from handtrack import (
    ArticulatedModel,
    CameraRig,
    HandScale,
    Status,
    TrackResult,
    load_model,
)
from handtrack.arrays import Floats
from handtrack.capture.calibration.rig_file import rig_json
from handtrack.geometry.rotation import rotation_matrix
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import PARTS
from tests.cameras import pinhole
from tests.sample_track import labels_of, posed_frame

CLAW = Path(__file__).parent / "claw.toml"
KINDS = ("right", "left", "body", "claw")
FPS = 50.0
LOST_ROW = 5


def sample_model(kind: str) -> ArticulatedModel:
    """Return a model of one of KINDS; hands are a person's own."""
    if kind == "claw":
        return load_model(CLAW)
    if kind == "body":
        return load_model("body34", scale=HandScale(1.03, {"thighs": 0.97}, {"hip_width": 0.5}))
    size = HandScale(0.94, {"thumb": 1.04, "little": 0.97}, std={"length_mm": 1.5})
    return load_model("hand26", side=kind, scale=size)


def sample_rig() -> CameraRig:
    """Return two cameras a metre and a half from the origin."""
    turns = {"front": [np.pi, 0.0, 0.0], "side": [np.pi, 0.6, 0.0]}
    return CameraRig(tuple(
        pinhole(name, (640, 480), (500, 505), rotation_matrix(np.array(turn)), (0, 0, 1.5), at=(320, 240))
        for name, turn in turns.items()
    ))  # fmt: skip


def smooth_poses(model: ArticulatedModel, frames: int, rng: np.random.Generator) -> Floats:
    """Return joint parameters (frames, S): every freedom wanders within its limits, the root turns all the way round."""
    knots = np.linspace(0, frames - 1, 5)
    low, high = model.limits.interval[6:].T
    wanted = rng.uniform(np.maximum(low, -3.0), np.minimum(high, 3.0), (5, len(low)))
    angles = make_interp_spline(knots, wanted, k=1)(np.arange(frames))
    turn = np.linspace(0.3, 6.5, frames)[:, None] * np.array([0.48, 0.6, 0.64])
    place = np.array([0.05, -0.02, 0.1]) + 0.1 * np.sin(np.linspace(0, 3, frames))[:, None]
    return np.concatenate([place, turn, angles], axis=1)


@lru_cache(maxsize=8)
def sample_sequence(kind: str, frames: int = 24) -> tuple[ArticulatedModel, TrackResult]:
    """Return a model and a sequence of it, from frame 3 on at 50 frames a second; row 5 is lost, row 6 doubtful."""
    model = sample_model(kind)
    rng = np.random.default_rng(KINDS.index(kind))
    results = []
    for row, values in enumerate(smooth_poses(model, frames, rng)):
        std = np.where(np.arange(len(values)) < 3, 0.001, 0.02) * rng.uniform(0.5, 2.0, len(values))
        status, reason = Status.TRACKED, None
        if row == LOST_ROW:
            status, reason, std = Status.LOST, Reason("unseen"), np.full(len(values), np.inf)
        elif row == LOST_ROW + 1:
            status, reason = Status.DOUBTFUL, Reason("open", part="hand", number=0.02)
        results.append(posed_frame(
            model, 3 + row, values, FPS, status=status, energy=1.0 + row, parameter_std=std,
            joint_covariance=np.tile(1.5e-3**2 * np.eye(3), (len(model.joint_names), 1, 1)), reason=reason,
            p_off_25mm=0.02 * row / frames,
            p_off_10mm=np.linspace(0.01, 0.2, len(PARTS)) if model.has_keypoints21 else None,
        ))  # fmt: skip
    labels = labels_of(
        model,
        f"invented {kind}",
        definition=model.definition_text,
        fps=FPS,
        cameras=rig_json(sample_rig()),
    )
    return model, labels.track(results)
