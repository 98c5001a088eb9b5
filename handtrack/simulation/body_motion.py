"""Known motions of a body for simulated recordings: poses joined smoothly, while it turns and sways."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import F, Floats, S
from handtrack.errors import unknown_name
from handtrack.model.articulated import ArticulatedModel

BODY_POSES: dict[str, dict[str, float]] = {
    "stand": {},
    "reach": {
        "left_shoulder_abd": 150, "left_shoulder_flex": -15, "left_elbow_flex": 15,
        "right_shoulder_abd": 100, "right_shoulder_flex": -30, "right_elbow_flex": 40,
        "right_hip_flex": 10, "right_hip_abd": 15, "spine_lean": -12, "neck_twist": 20,
        "left_wrist_flex": -40, "left_wrist_abd": 10, "right_wrist_flex": 35,
    },
    "lunge": {
        "left_hip_flex": 75, "left_knee_flex": 80, "left_ankle_flex": 5, "right_hip_flex": -20,
        "right_knee_flex": 25, "right_ankle_flex": -25, "left_shoulder_abd": 70, "left_shoulder_flex": 40,
        "right_shoulder_abd": 75, "right_shoulder_flex": -45, "spine_twist": -15,
        "left_wrist_flex": 50, "right_wrist_flex": -30, "right_wrist_abd": -20,
    },
    "kick": {
        "right_hip_flex": 80, "right_knee_flex": 25, "right_ankle_flex": -30, "left_knee_flex": 15,
        "left_shoulder_abd": 95, "left_shoulder_flex": -35, "right_shoulder_abd": 80,
        "right_shoulder_flex": -50, "spine_flex": 10, "neck_flex": 10,
    },
    "bow": {
        "spine_flex": 50, "neck_flex": 20, "left_hip_flex": 30, "left_knee_flex": 25, "right_hip_flex": 30,
        "right_knee_flex": 25, "left_shoulder_abd": 30, "left_shoulder_flex": -35, "right_shoulder_abd": 30,
        "right_shoulder_flex": -35,
    },
}  # fmt: skip
"""degrees that differ from rest; those of wrists are for bodies that have them"""

BODY_MOTIONS: dict[str, tuple[str, ...]] = {
    "dance": ("stand", "reach", "lunge", "stand", "kick", "bow", "stand"),
    "still": ("stand", "stand"),
    "greet": ("stand", "reach", "stand", "bow", "stand"),
}

_SWAY_M = 0.06
_TURN_RAD = 0.12


def body_pose(model: ArticulatedModel, name: str) -> Floats[S]:
    """Return joint parameters of a named pose of a body, the pelvis at the world's origin."""
    if name not in BODY_POSES:
        raise unknown_name("pose of a body", name, tuple(BODY_POSES))
    joint = model.rest.copy()
    for parameter, degrees in BODY_POSES[name].items():
        if "wrist" not in parameter or parameter in model.parameter_names:
            joint[model.skeleton.parameter(parameter)] = np.deg2rad(degrees)
    return joint


def body_motion(
    model: ArticulatedModel, name: str, frames: int, rng: np.random.Generator, wander: float = 1.0
) -> Floats[F, S]:
    """Return joint parameters of a named motion, each within its limits.

    Angles pass through the poses without overshoot; the pelvis stays near the world's origin, where it sways and turns
    (`wander` = 1: about 6 cm and 7°, and a quarter turn there and back; 0: it stays).
    """
    from scipy.interpolate import CubicSpline, PchipInterpolator

    if name not in BODY_MOTIONS:
        raise unknown_name("motion of a body", name, tuple(BODY_MOTIONS))
    keys = np.stack([body_pose(model, pose) for pose in BODY_MOTIONS[name]])
    time = np.linspace(0.0, 1.0, frames)
    joint = PchipInterpolator(np.linspace(0.0, 1.0, len(keys)), keys, axis=0)(time)
    path = rng.normal(size=(len(keys), 6)) * ([_SWAY_M] * 3 + [_TURN_RAD] * 3) * wander
    joint[:, :6] = CubicSpline(np.linspace(0.0, 1.0, len(keys)), path, axis=0)(time)
    joint[:, 4] += wander * np.deg2rad(45.0) * np.sin(2 * np.pi * time)
    return joint
