"""Angles of wrist and fingers by the ISB's convention (Wu et al. 2005, part II, section 4). Derivation: docs/reference/joint_angles.md."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, D4, Axes, B, F, Floats, Ints, K, S
from handtrack.geometry.rotation import euler_angles
from handtrack.model.articulated import FINGERS, ArticulatedModel

ROTATIONS = ("flexion", "ulnar_deviation", "pronation")
"""α about the proximal segment's Z, β about the floating axis, γ about the distal segment's Y; all positive as named"""
_OF_THE_THUMBS_BASE = ("flexion", "adduction", "pronation")
"""the same: the thumb lies across the palm, so that what leads to the trapezium's −Z leads to the palm's plane"""

_VOLAR_PROXIMAL_RADIAL = np.array([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])
"""columns: X towards the palm, Y towards the body, Z towards the thumb, in a right hand's bone frame (+y distal, +z dorsal)"""
_NOTHING = 1e-9  # a slope that is rounding
_FOREARM = np.diag([-1.0, -1.0, 1.0])  # its bone runs from the wrist: +y is proximal
_COONEY_DEG = (48.0, -38.0, 80.0)
"""α, β, γ of the trapezium's axes against the third metacarpal's, medians of ten hands: 48° of flexion, 38° of abduction, 80° of pronation (Cooney et al. 1981)"""

JOINTS: dict[str, tuple[str, str]] = {
    "wrist": ("forearm", "middle_metacarpal"),
    "thumb_cmc": ("middle_metacarpal", "thumb_metacarpal"),
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
"""joint → proximal and distal bone. The thumb's base is measured from the trapezium, which lies fixed to the third metacarpal"""


def isb_angles(model: ArticulatedModel, T_world_bone: Floats[F, B, D4, D4]) -> dict[str, Floats[F]]:
    """Return the angles [rad] by `<joint>_<rotation>`, of the joints whose bones the model has; none of a body.

    Zero is where the axes of both segments are parallel, not the model's zero pose: the knuckles' ulnar deviation counts from the
    metacarpal. A left hand's are those of its mirror image, as the ISB recommends.
    """
    names, before, after = _joints_of(model)
    turns = T_world_bone[..., :3, :3]
    relative = _relative(turns[:, before], turns[:, after], *_axes(names, model.side))
    return _by_name(names, euler_angles(relative, "ZXY"))


def isb_std(
    model: ArticulatedModel, parameters: Floats[F, S], parameter_std: Floats[F, S]
) -> dict[str, Floats[F]]:
    """Return the standard deviations [rad] of `isb_angles`, carried over from those of the joint parameters [rad].

    A result does not have how errors of parameters go together: those of one joint's two freedoms count as independent, which is
    all that matters here, for no angle depends on another joint. Infinite where a freedom that the angle depends on is.
    """
    names, before, after = _joints_of(model)
    axes = _axes(names, model.side)
    spread = np.zeros((len(parameters), len(names), 3))
    for frame, values in enumerate(parameters):
        bones, twists, _ = model.linearize(model.transform.solver_params(values))
        turns = bones.rotation[before], bones.rotation[after]
        slopes = _slopes(*turns, twists[after, 3:] - twists[before, 3:], *axes)
        variance = np.where(np.abs(slopes) < _NOTHING, 0.0, slopes) ** 2
        blind = ~np.isfinite(parameter_std[frame])
        spread[frame] = np.sqrt(variance @ np.where(blind, 0.0, parameter_std[frame]) ** 2)
        spread[frame][(variance[..., blind] > 0.0).any(axis=-1)] = np.inf
    return _by_name(names, spread)


def _joints_of(model: ArticulatedModel) -> tuple[list[str], Ints[K], Ints[K]]:
    """Return the joints that a model has, their proximal and their distal bones."""
    bones = model.skeleton.bone_names
    own = {name: pair for name, pair in JOINTS.items() if set(pair) <= set(bones)}
    before, after = (np.array([bones.index(pair[k]) for pair in own.values()], int) for k in (0, 1))
    return list(own), before, after


def _axes(names: list[str], side: str) -> tuple[Floats[K, D3, D3], Floats[D3, D3]]:
    """Return the proximal segments' axes X, Y, Z in their bones' frames, and the distal ones'; of a left hand its mirror image's."""
    axes = np.tile(_VOLAR_PROXIMAL_RADIAL, (len(names), 1, 1))
    for k, name in enumerate(names):
        if name == "wrist":
            axes[k] = _FOREARM @ axes[k]
        elif name == "thumb_cmc":
            axes[k] = axes[k] @ _turned(np.deg2rad([_COONEY_DEG]))[0]
    mirror = np.diag([-1.0 if side == "left" else 1.0, 1.0, 1.0])
    return mirror @ axes, mirror @ _VOLAR_PROXIMAL_RADIAL


def _relative(
    before: Floats[*Axes, K, D3, D3],
    after: Floats[*Axes, K, D3, D3],
    near: Floats[K, D3, D3],
    far: Floats[D3, D3],
) -> Floats[*Axes, K, D3, D3]:
    """Return the distal segments' axes in the proximal ones', from the bones' turns and both segments' axes in them."""
    return np.swapaxes(near, 1, 2) @ (np.swapaxes(before, -1, -2) @ after) @ far


def _by_name(names: list[str], values: Floats[F, K, D3]) -> dict[str, Floats[F]]:
    found: dict[str, Floats] = {}
    for k, joint in enumerate(names):
        turns = _OF_THE_THUMBS_BASE if joint == "thumb_cmc" else ROTATIONS
        found |= {f"{joint}_{turn}": values[:, k, i] for i, turn in enumerate(turns)}
    return found


def _slopes(
    before: Floats[K, D3, D3],
    after: Floats[K, D3, D3],
    turning: Floats[K, D3, S],
    near: Floats[K, D3, D3],
    far: Floats[D3, D3],
) -> Floats[K, D3, S]:
    """Return the derivatives of α, β, γ by the joint parameters: the relative angular velocity is ẑ α̇ + Rz x̂ β̇ + Rz Rx ŷ γ̇.

    turning: how fast the distal bones turn against the proximal ones, world.
    """
    sense = np.sign(np.linalg.det(far))  # a mirror turns the sense of what turns
    turning = np.swapaxes(sense * near, 1, 2) @ (np.swapaxes(before, 1, 2) @ turning)
    angles = euler_angles(_relative(before, after, near, far), "ZXY")
    flexed, deviated = _turned(angles * (1.0, 0.0, 0.0)), _turned(angles * (1.0, 1.0, 0.0))
    axes = np.stack([flexed[..., 2], flexed[..., 0], deviated[..., 1]], axis=-1)
    return np.linalg.solve(axes, turning)


def _turned(angles: Floats[K, D3]) -> Floats[K, D3, D3]:
    """Return Rz(α) Rx(β) Ry(γ) [rad]."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("ZXY", angles).as_matrix()
