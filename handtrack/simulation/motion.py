"""Known motions for simulated recordings: named poses joined smoothly, while the hand or body turns and wanders."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import F, Floats, S
from handtrack.errors import check_name
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.pose_library import named_pose

MOTIONS: dict[str, dict[str, tuple[str, ...]]] = {
    "hand": {
        "open_fist_open": ("open", "curl", "fist", "curl", "open"),
        "curl": ("flat", "curl", "flat"),
        "gestures": ("open", "pinch", "open", "point", "curl", "fist", "open"),
        "still": ("open", "open"),
    },
    "body": {
        "dance": ("stand", "reach", "lunge", "stand", "kick", "bow", "stand"),
        "still": ("stand", "stand"),
        "greet": ("stand", "reach", "stand", "bow", "stand"),
    },
}
"""names of poses by motion, of each kind of model"""

_WANDER = {"hand": (0.02, 0.25), "body": (0.06, 0.12)}  # [m, rad]


def motion(
    model: ArticulatedModel, name: str, frames: int, rng: np.random.Generator, wander: float = 1.0
) -> Floats[F, S]:
    """Return joint parameters of a named motion.

    Angles pass through the poses without overshoot. A hand's palm stays near the world's origin, its back turned to +z, and
    wanders smoothly (`wander` = 1: about 2 cm and 15°; 0: the root stays). A body's pelvis stays near there, where it sways and
    turns (about 6 cm and 7°, and a quarter turn there and back).
    """
    from scipy.interpolate import CubicSpline, PchipInterpolator

    known, is_body = MOTIONS[model.kind], model.kind == "body"
    check_name("motion", name, known)
    keys = np.stack([named_pose(model, pose) for pose in known[name]])
    time, knots = np.linspace(0.0, 1.0, frames), len(keys) if is_body else max(len(keys), 4)
    joint = PchipInterpolator(np.linspace(0.0, 1.0, len(keys)), keys, axis=0)(time)
    path = rng.normal(size=(knots, 6)) * np.repeat(_WANDER[model.kind], 3) * wander
    joint[:, :6] = CubicSpline(np.linspace(0.0, 1.0, knots), path, axis=0)(time)
    if is_body:
        joint[:, 4] += wander * np.deg2rad(45.0) * np.sin(2 * np.pi * time)
    else:
        joint[:, 1] -= 0.09  # the palm's middle, not the wrist, at the origin
    return joint
