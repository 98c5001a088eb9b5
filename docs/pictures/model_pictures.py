"""Draw the 2007 paper's Fig. 1: skeleton, flesh, a camera's projected field, and all three in one view."""

from __future__ import annotations

import cv2
import numpy as np

from handtrack.arrays import D2, D3, Array, Bytes, Floats, H, N, P, W
from handtrack.diagnostics.residuals import field_picture
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.simulation.render import render, shade
from handtrack.simulation.simulate import simulated_rig

SKIN, BONE = np.array([224, 172, 140.0]), np.array([236, 226, 205.0])
PAPER = np.array([250.0, 250.0, 250.0])
_BONE_M = 0.0022  # half a bone's thickness in the picture
_STEP_M = 0.0008  # a bone is a string of balls this far apart
_BEHIND_M = 0.10  # the field's picture stands this far behind the hand
_GHOST = 0.45  # how much of the flesh is seen where all is shown


def segments(model: ArticulatedModel, bones: BonePoses) -> Floats[N, D2, D3]:
    """Return segments, world [m]: from each bone's start to its child's, and to the fingertips."""
    parent = model.skeleton.parent
    lines = [(bones.position[p], bones.position[b]) for b, p in enumerate(parent) if p >= 0]
    joints = dict(zip(model.joint_names, model.joint_positions(bones), strict=True))
    for finger in FINGERS:
        last = "ip" if finger == "thumb" else "dip"
        lines.append((joints[f"{finger}_{last}"], joints[f"{finger}_tip"]))
    return np.array(lines)


def skeleton_balls(model: ArticulatedModel, bones: BonePoses) -> Ellipsoids:
    """Return balls that together look like cylinders along the bones, thicker at the joints."""
    centres, radii = [], []
    for start, end in segments(model, bones):
        count = max(int(np.linalg.norm(end - start) / _STEP_M), 1)
        share = np.linspace(0, 1, count + 1)[:, None]
        centres.append(start + share * (end - start))
        radii.append(np.full(count + 1, _BONE_M))
        radii[-1][[0, -1]] *= 1.7
    centre, radius = np.concatenate(centres), np.concatenate(radii)
    count = len(centre)
    turn = np.tile(np.eye(3), (count, 1, 1))
    return Ellipsoids(np.zeros(count, int), centre, turn, np.tile(radius[:, None], (1, 3)))


def rendered(
    camera: Camera, ellipsoids: Ellipsoids, color: Floats[D3], background: Array[H, W, D3]
) -> Bytes[H, W, D3]:
    """Return a picture RGB of ellipsoids in one colour."""
    front, _, normal = render(camera, ellipsoids)
    colors = np.tile(color, (len(ellipsoids.radii), 1))
    height, width = front.shape
    return shade(front, normal, colors, np.broadcast_to(background, (height, width, 3)))


def model_pictures(
    model: ArticulatedModel, params: Floats[P], size: tuple[int, int] = (640, 480)
) -> dict[str, Bytes[H, W, D3]]:
    """Return four pictures RGB of a pose, by title."""
    beside, *_, seen_by = simulated_rig(3, size).cameras
    bones = model.bones(params)
    balls, ellipsoids = skeleton_balls(model, bones), model.ellipsoids["fine"].posed(bones)
    field = field_picture(seen_by, ellipsoids)
    backdrop = _projected(field, seen_by, beside)
    bare = rendered(beside, balls, BONE, PAPER)
    dressed = rendered(beside, ellipsoids, SKIN, backdrop)
    inside = rendered(beside, balls, BONE, dressed)
    hidden = (inside != dressed).any(axis=2, keepdims=True)
    together = np.where(hidden, _GHOST * dressed + (1 - _GHOST) * inside, dressed)
    return {
        "skeleton": bare,
        "flesh": rendered(beside, ellipsoids, SKIN, PAPER),
        f"field seen by {seen_by.name}": field,
        "all three": together.astype(np.uint8),
    }


def _projected(picture: Bytes, camera: Camera, viewer: Camera) -> Bytes:
    """Return what `viewer` sees of a camera's picture on a screen behind the world's origin."""
    width, height = camera.size
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], float)
    depth = float(camera.to_camera(np.zeros(3))[2]) + _BEHIND_M
    rays = np.concatenate([corners, np.ones((4, 1))], axis=1) @ np.linalg.inv(camera.matrix).T
    screen = (rays * depth - camera.translation) @ camera.rotation
    seen = viewer.project(screen).astype(np.float32)
    turn = cv2.getPerspectiveTransform(corners.astype(np.float32), seen)
    paper = tuple(float(x) for x in PAPER)
    return np.asarray(cv2.warpPerspective(picture, turn, viewer.size, borderValue=paper), np.uint8)
