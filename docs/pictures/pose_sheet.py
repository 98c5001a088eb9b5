"""Draw a sheet of named poses, rendered from the model's flesh."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from handtrack.arrays import D3, Array, H, W
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.pose_library import named_pose, pose_turn
from handtrack.simulation.render import pixel_rays, render, shade

_BY_FINGER = {
    "thumb": (90, 120, 215),
    "index": (110, 185, 235),
    "middle": (120, 200, 150),
    "ring": (205, 175, 110),
    "little": (190, 130, 180),
}
_PALM = (185, 190, 200)
_DISTANCE_M = 0.9
_VISIBLE_M = 0.235


def pose_sheet(
    model: ArticulatedModel, names: Sequence[str], columns: int = 7, size: int = 180
) -> Array[H, W, D3]:
    """Return a picture BGR of poses in rows, each `size` pixels wide, held as `pose_turn` says."""
    tiles = [pose_picture(model, name, size) for name in names]
    while len(tiles) % columns:
        tiles.append(np.full_like(tiles[0], 255))
    rows = [cv2.hconcat(tiles[i : i + columns]) for i in range(0, len(tiles), columns)]
    return np.asarray(cv2.vconcat(rows))


def pose_picture(model: ArticulatedModel, name: str, size: int = 180) -> Array[H, W, D3]:
    """Return one pose (size, size, 3) BGR with its name, seen by someone opposite the signer."""
    joint = named_pose(model, name)
    joint[3:6] = pose_turn(name, model.side)
    bones = model.bones(model.transform.solver_params(joint))
    camera = _facing(model.joint_positions(bones), size)
    ellipsoids = model.ellipsoids["fine"].posed(bones)
    colours = np.array([_colour(model, int(bone)) for bone in ellipsoids.bone], dtype=np.uint8)
    front, _, normal = render(camera, ellipsoids, pixel_rays(camera))
    picture = shade(front, normal, colours, np.full((size, size, 3), 255, np.uint8))
    label = name.removeprefix("lsf_").upper() if name.startswith("lsf_") else name
    cv2.putText(
        picture, label, (6, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.65, (40, 40, 40), 1, cv2.LINE_AA
    )
    return picture


def _facing(joints: np.ndarray, size: int) -> Camera:
    """Return the viewer's camera: it looks along −z with y up, at the middle of the hand."""
    middle = (joints.min(axis=0) + joints.max(axis=0)) / 2
    rotation = np.diag([1.0, -1.0, -1.0])
    focal = size * _DISTANCE_M / _VISIBLE_M
    matrix = np.array([[focal, 0, (size - 1) / 2], [0, focal, (size - 1) / 2], [0, 0, 1]])
    centre = middle + [0, 0, _DISTANCE_M]
    return Camera("viewer", (size, size), matrix, np.zeros(5), rotation, -rotation @ centre)


def _colour(model: ArticulatedModel, bone: int) -> tuple[int, int, int]:
    finger, _, part = model.skeleton.bone_names[bone].partition("_")
    moving = part not in ("carpal", "metacarpal") or (finger == "thumb" and part != "carpal")
    return _BY_FINGER.get(finger, _PALM) if moving else _PALM
