"""Angles of wrist and fingers by the ISB's convention (Wu et al. 2005, part II, section 4). Derivation: docs/derivations/isb.md."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, D4, B, F, Floats
from handtrack.model.articulated import FINGERS, ArticulatedModel

ROTATIONS = ("flexion", "ulnar_deviation", "pronation")
"""α about the proximal segment's Z, β about the floating axis, γ about the distal segment's Y; all positive as named"""

_VOLAR_PROXIMAL_RADIAL = np.array([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])
"""columns: X towards the palm, Y towards the body, Z towards the thumb, in a right hand's bone frame (+y distal, +z dorsal)"""
_MIRROR = np.diag([-1.0, 1.0, 1.0])
_HALF_TURN = np.diag(
    [-1.0, -1.0, 1.0]
)  # the forearm's bone runs from the wrist: its +y is proximal

JOINTS: dict[str, tuple[str, str]] = {
    "wrist": ("forearm", "middle_metacarpal"),
    "thumb_mcp": ("thumb_metacarpal", "thumb_proximal"),
    "thumb_ip": ("thumb_proximal", "thumb_distal"),
} | {
    f"{finger}_{joint}": (f"{finger}_{proximal}", f"{finger}_{distal}")
    for finger in FINGERS[1:]
    for joint, proximal, distal in (
        ("mcp", "metacarpal", "proximal"),
        ("pip", "proximal", "intermediate"),
        ("dip", "intermediate", "distal"),
    )
}
"""joint → proximal and distal bone. The thumb's base is not there: the model has no trapezium to measure from"""


def isb_angles(model: ArticulatedModel, T_world_bone: Floats[F, B, D4, D4]) -> dict[str, Floats[F]]:
    """Return the angles [rad] by `<joint>_<rotation>`, of the joints whose bones the model has; none of a body.

    Zero is where the axes of both segments are parallel, not the model's zero pose: the knuckles' ulnar deviation counts from the
    metacarpal. A left hand's are those of its mirror image, as the ISB recommends.
    """
    names, turns = model.skeleton.bone_names, T_world_bone[..., :3, :3]
    found: dict[str, Floats] = {}
    for joint, (proximal, distal) in JOINTS.items():
        if proximal not in names or distal not in names:
            continue
        before, after = turns[:, names.index(proximal)], turns[:, names.index(distal)]
        if proximal == "forearm":
            before = before @ _HALF_TURN
        relative = np.swapaxes(before, 1, 2) @ after
        if model.side == "left":
            relative = _MIRROR @ relative @ _MIRROR
        angles = _zxy(_VOLAR_PROXIMAL_RADIAL.T @ relative @ _VOLAR_PROXIMAL_RADIAL)
        found |= {f"{joint}_{name}": angles[:, i] for i, name in enumerate(ROTATIONS)}
    return found


def _zxy(rotation: Floats[F, D3, D3]) -> Floats[F, D3]:
    """Return α, β, γ of R = Rz(α) Rx(β) Ry(γ) [rad]."""
    flexion = np.arctan2(-rotation[:, 0, 1], rotation[:, 1, 1])
    deviation = np.arcsin(np.clip(rotation[:, 2, 1], -1.0, 1.0))
    turn = np.arctan2(-rotation[:, 2, 0], rotation[:, 2, 2])
    return np.stack([flexion, deviation, turn], axis=1)
