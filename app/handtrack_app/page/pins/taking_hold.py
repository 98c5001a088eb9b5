"""What a pointer takes hold of in a camera's picture: a joint where it is near one, else the point of a segment under it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import viser
import viser.transforms as vtf

from handtrack.arrays import D3, Floats
from handtrack_app.page.scene.zoom import Pixel, ray_pixel
from handtrack_app.protocol.snapshots import HAND_REACH_M, CameraCard, PoseSnapshot, SessionSnapshot

NEAR_JOINT_M = 0.007
"""as near as a finger is thick; of a body, as much more as it is larger"""
BEHIND = 4.0
"""times as far as that from what is pointed at, a joint lies behind it, though it is seen beside it"""
LEAST_AWAY_M = 0.05
"""nearer to a camera nothing is any larger in its image"""


@dataclass(frozen=True)
class Hold:
    """A joint; or a bone, and a point in its frame [m]."""

    joint: str = ""
    bone: str = ""
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def place(self, session: SessionSnapshot, pose: PoseSnapshot) -> Floats[D3]:
        """Return where a pose has it, world [m]."""
        if self.joint:
            return pose.joints[session.joint_names.index(self.joint)]
        bone = session.bone_names.index(self.bone)
        return pose.bone_position[bone] + pose.bone_rotation[bone] @ np.array(self.point)


def view_card(camera: viser.CameraHandle) -> CameraCard:
    """Return a free view as a camera whose image is the window."""
    width, height = max(camera.image_width, 1), max(camera.image_height, 1)
    focal = 0.5 * height / np.tan(0.5 * float(camera.fov))
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    turn = vtf.SO3(np.asarray(camera.wxyz, dtype=float)).as_matrix()
    centre = np.asarray(camera.position, dtype=float)
    return CameraCard("", (width, height), matrix, turn, centre)


def near_joint_m(session: SessionSnapshot) -> float:
    """Return how far from a joint is still at it: half of what carries it is as thick as that."""
    return NEAR_JOINT_M * session.reach_m / HAND_REACH_M


def ellipsoid_at(session: SessionSnapshot, pose: PoseSnapshot, at: Floats[D3]) -> int | None:
    """Return the ellipsoid of the flesh that a point, world [m], is in or next to; None where the pose is not of this model."""
    if len(pose.centre) != len(session.radii) or not len(session.radii):
        return None
    inside = np.einsum("nji,nj->ni", pose.rotation, at - pose.centre) / session.radii
    return int(np.argmin((inside**2).sum(axis=1)))


def hold_at(
    session: SessionSnapshot,
    pose: PoseSnapshot,
    card: CameraCard,
    ellipsoid: int,
    at: Floats[D3],
) -> Hold | None:
    """Return what is held where a pointer meets an ellipsoid at a point, world [m]; None for what is not of this pose."""
    if not 0 <= ellipsoid < len(session.ellipsoid_bone) or not np.isfinite(at).all():
        return None
    way = at - card.centre
    pixel = ray_pixel(card, way)
    if pixel is None:
        return None
    away = float(way @ card.rotation[:, 2])
    near = near_joint_m(session) * float(card.matrix[0, 0]) / max(away, LEAST_AWAY_M)
    joint = _nearest_joint(session, pose, card, pixel, at, near)
    if joint is not None:
        return Hold(joint=joint)
    bone = int(session.ellipsoid_bone[ellipsoid])
    x, y, z = (
        float(v) for v in pose.bone_rotation[bone].T @ (_on_ellipsoid(session, pose, card, ellipsoid, at) - pose.bone_position[bone])
    )  # fmt: skip
    return Hold(bone=session.bone_names[bone], point=(x, y, z))


def _nearest_joint(
    session: SessionSnapshot,
    pose: PoseSnapshot,
    card: CameraCard,
    pixel: Pixel,
    at: Floats[D3],
    near_px: float,
) -> str | None:
    """Return the joint that lies nearest to a pixel, within so many; not one that lies far behind what is pointed at."""
    best, found = near_px, None
    for name, place in zip(session.joint_names, pose.joints, strict=True):
        seen = ray_pixel(card, place - card.centre)
        if seen is None or float(np.linalg.norm(place - at)) > BEHIND * near_joint_m(session):
            continue
        off = float(np.hypot(seen[0] - pixel[0], seen[1] - pixel[1]))
        if off < best:
            best, found = off, name
    return found


def _on_ellipsoid(
    session: SessionSnapshot, pose: PoseSnapshot, card: CameraCard, ellipsoid: int, at: Floats[D3]
) -> Floats[D3]:
    """Return where the ray through a point first meets an ellipsoid; the nearest point of the ray to its centre where it misses."""
    radii, turn = session.radii[ellipsoid], pose.rotation[ellipsoid]
    way = (turn.T @ (at - card.centre)) / radii
    begin = (turn.T @ (card.centre - pose.centre[ellipsoid])) / radii
    a, b, c = way @ way, way @ begin, begin @ begin - 1.0
    root = max(float(b * b - a * c), 0.0)
    return card.centre + float((-b - np.sqrt(root)) / a) * (at - card.centre)
