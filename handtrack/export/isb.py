"""Angles of wrist and fingers by the ISB's convention (Wu et al. 2005, part II, section 4). Derivation: docs/reference/joint_angles.md."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, D4, D6, Axes, B, F, Floats, Ints, K, S, array_dataclass
from handtrack.geometry.rotation import euler_angles
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.model.kinematics import BonePoses

ROTATIONS = ("flexion", "ulnar_deviation", "pronation")
"""α about the proximal segment's Z, β about the floating axis, γ about the distal segment's Y; all positive as named"""
_OF_THE_THUMBS_BASE = ("flexion", "adduction", "pronation")
"""the same: the thumb lies across the palm, so that what leads to the trapezium's −Z leads to the palm's plane"""

_VOLAR_PROXIMAL_RADIAL = np.array([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])
"""columns: X towards the palm, Y towards the body, Z towards the thumb, in a right hand's bone frame (+y distal, +z dorsal)"""
_MIRROR = np.diag([-1.0, 1.0, 1.0])
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
    own = _joints_of(model)
    turns = T_world_bone[..., :3, :3]
    angles = euler_angles(own.relative_axes(turns[:, own.before], turns[:, own.after]), "ZXY")
    return _by_name(own, angles)


def isb_std(
    model: ArticulatedModel, parameters: Floats[F, S], parameter_std: Floats[F, S]
) -> dict[str, Floats[F]]:
    """Return the standard deviations [rad] of `isb_angles`, carried over from those of the joint parameters [rad].

    A result does not have how errors of parameters go together: those of one joint's two freedoms count as independent, which is
    all that matters here, for no angle depends on another joint. Infinite where a freedom that the angle depends on is.
    """
    own = _joints_of(model)
    spread = np.zeros((len(parameters), len(own.names), 3))
    for frame, values in enumerate(parameters):
        slopes = _slopes(own, *model.linearize(model.transform.solver_params(values))[:2])
        variance = np.where(np.abs(slopes) < _NOTHING, 0.0, slopes) ** 2
        blind = ~np.isfinite(parameter_std[frame])
        spread[frame] = np.sqrt(variance @ np.where(blind, 0.0, parameter_std[frame]) ** 2)
        spread[frame][(variance[..., blind] > 0.0).any(axis=-1)] = np.inf
    return _by_name(own, spread)


@array_dataclass
class _Joints:
    """The joints that a model has."""

    names: tuple[str, ...]
    before: Ints[K]
    """their proximal bones"""
    after: Ints[K]
    """their distal bones"""
    axes: Floats[K, D3, D3]
    """the proximal segments' axes X, Y, Z in their bones' frames, of a right hand"""
    mirrored: bool

    def relative_axes(
        self, before: Floats[*Axes, K, D3, D3], after: Floats[*Axes, K, D3, D3]
    ) -> Floats[*Axes, K, D3, D3]:
        """Return the distal segments' axes in the proximal ones'."""
        relative = np.swapaxes(before, -1, -2) @ after
        if self.mirrored:
            relative = _MIRROR @ relative @ _MIRROR
        return np.swapaxes(self.axes, 1, 2) @ relative @ _VOLAR_PROXIMAL_RADIAL


def _joints_of(model: ArticulatedModel) -> _Joints:
    bones = model.skeleton.bone_names
    own = {name: pair for name, pair in JOINTS.items() if set(pair) <= set(bones)}
    before, after = (np.array([bones.index(pair[k]) for pair in own.values()], int) for k in (0, 1))
    axes = np.tile(_VOLAR_PROXIMAL_RADIAL, (len(own), 1, 1))
    for k, name in enumerate(own):
        if name == "wrist":
            axes[k] = _FOREARM @ axes[k]
        elif name == "thumb_cmc":
            axes[k] = axes[k] @ _turned(np.deg2rad([_COONEY_DEG]))[0]
    return _Joints(tuple(own), before, after, axes, model.side == "left")


def _by_name(own: _Joints, values: Floats[F, K, D3]) -> dict[str, Floats[F]]:
    found: dict[str, Floats] = {}
    for k, joint in enumerate(own.names):
        turns = _OF_THE_THUMBS_BASE if joint == "thumb_cmc" else ROTATIONS
        found |= {f"{joint}_{turn}": values[:, k, i] for i, turn in enumerate(turns)}
    return found


def _slopes(own: _Joints, bones: BonePoses, twists: Floats[B, D6, S]) -> Floats[K, D3, S]:
    """Return the derivatives of α, β, γ by the joint parameters: the relative angular velocity is ẑ α̇ + Rz x̂ β̇ + Rz Rx ŷ γ̇."""
    before = bones.rotation[own.before]
    turning = np.swapaxes(before, 1, 2) @ (twists[own.after, 3:] - twists[own.before, 3:])
    if own.mirrored:
        turning = -_MIRROR @ turning  # a mirror turns the sense of what turns
    turning = np.swapaxes(own.axes, 1, 2) @ turning
    angles = euler_angles(own.relative_axes(before, bones.rotation[own.after]), "ZXY")
    flexed, deviated = _turned(angles * (1.0, 0.0, 0.0)), _turned(angles * (1.0, 1.0, 0.0))
    axes = np.stack([flexed[..., 2], flexed[..., 0], deviated[..., 1]], axis=-1)
    return np.linalg.solve(axes, turning)


def _turned(angles: Floats[K, D3]) -> Floats[K, D3, D3]:
    """Return Rz(α) Rx(β) Ry(γ) [rad]."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("ZXY", angles).as_matrix()
