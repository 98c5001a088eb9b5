"""Known motions for simulated recordings: named poses joined smoothly, while the hand turns and wanders."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import F, Floats, S
from handtrack.errors import unknown_name
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.pose_library import named_pose

MOTIONS: dict[str, tuple[str, ...]] = {
    "open_fist_open": ("open", "curl", "fist", "curl", "open"),
    "curl": ("flat", "curl", "flat"),
    "gestures": ("open", "pinch", "open", "point", "curl", "fist", "open"),
    "still": ("open", "open"),
}

_WANDER_M = 0.02
_TURN_RAD = 0.25


def motion(
    model: ArticulatedModel, name: str, frames: int, rng: np.random.Generator, wander: float = 1.0
) -> Floats[F, S]:
    """Return joint parameters of a named motion.

    Angles pass through the poses without overshoot; the palm stays near the world's origin, its back
    turned to +z, and wanders smoothly (`wander` = 1: about 2 cm and 15°; 0: the root stays).
    """
    from scipy.interpolate import CubicSpline, PchipInterpolator

    if name not in MOTIONS:
        raise unknown_name("motion", name, tuple(MOTIONS))
    keys = np.stack([named_pose(model, pose) for pose in MOTIONS[name]])
    at = np.linspace(0.0, 1.0, len(keys))
    time = np.linspace(0.0, 1.0, frames)
    joint = PchipInterpolator(at, keys, axis=0)(time)
    knots = max(len(keys), 4)
    path = rng.normal(size=(knots, 6)) * ([_WANDER_M] * 3 + [_TURN_RAD] * 3) * wander
    joint[:, :6] = CubicSpline(np.linspace(0.0, 1.0, knots), path, axis=0)(time)
    joint[:, 1] -= 0.09  # the palm's middle, not the wrist, at the origin
    return joint
