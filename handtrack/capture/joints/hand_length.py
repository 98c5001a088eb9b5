"""How long a hand is whose 2D joints two cameras or more have: what a calibration's unit can be told by."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from handtrack.arrays import D3, Floats, N
from handtrack.capture.joints.given_joints import Hand
from handtrack.capture.joints.joint_names import JOINTS
from handtrack.geometry.camera import CameraRig

_ALONG = [
    JOINTS.index(name) for name in ("wrist", "middle_mcp", "middle_pip", "middle_dip", "middle_tip")
]
_MOST = 60  # frames that are asked
_PARALLEL = 1e-3  # least eigenvalue of Σ(1 − a aᵀ): rays some 2° apart


def hand_length(rig: CameraRig, joints: Mapping[str, Mapping[int, Hand]]) -> float | None:
    """Return the length from wrist to middle fingertip along the bones, in the rig's unit, the median of some frames.

    joints: by camera and frame, [px] in the image as it was taken. None where no frame has them all in two cameras.
    """
    every = sorted({frame for frames in joints.values() for frame in frames})
    chosen = (
        [every[i] for i in np.unique(np.linspace(0, len(every) - 1, _MOST).astype(int))]
        if every
        else []
    )
    lengths = []
    for frame in chosen:
        seen = {name: frames[frame] for name, frames in joints.items() if frame in frames}
        points = [_point(rig, {name: hand[i, :2] for name, hand in seen.items()}) for i in _ALONG]
        if all(point is not None for point in points):
            lengths.append(float(np.linalg.norm(np.diff(np.array(points), axis=0), axis=1).sum()))
    return float(np.median(lengths)) if lengths else None


def _point(rig: CameraRig, pixels: Mapping[str, Floats[N]]) -> Floats[D3] | None:
    """Return where viewing rays come nearest to each other."""
    total, right = np.zeros((3, 3)), np.zeros(3)
    for name, pixel in pixels.items():
        ray = rig[name].rays(pixel)
        if np.isfinite(ray).all():
            across = np.eye(3) - np.outer(ray, ray)
            total, right = total + across, right + across @ rig[name].centre
    if np.linalg.eigvalsh(total)[0] < _PARALLEL:
        return None
    return np.linalg.solve(total, right)
