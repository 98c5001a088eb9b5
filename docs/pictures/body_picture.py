"""Draw docs/figures/body34.png: the body's superquadrics from four sides, dancing, and its ellipsoids.

Run: python -m docs.pictures.body_picture [FILE]
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import D3, Bytes, Floats, H, P, W
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.model.part_mesh import PartMesh, ellipsoid_mesh
from handtrack.model.pose_library import named_pose

_SIZE = (190, 350)  # pixels of one picture
_PIXELS_PER_M = 148.0
_FINER = 3  # drawn so many times larger, then averaged
_DOWN_M = 0.12  # the pelvis stands this far below the picture's middle
_LIGHT = np.array([0.35, 0.5, 0.8]) / np.linalg.norm([0.35, 0.5, 0.8])
_SKIN_BGR = np.array([140.0, 172, 224])
_SUBPIXEL_BITS = 4
_SHADES = 64


def body_pictures(model: ArticulatedModel) -> Bytes[H, W, D3]:
    """Return the pictures side by side BGR."""
    if model.superquadrics is None:
        raise HandtrackError(f"body picture: the model '{model.name}' has no superquadrics.")
    parts = model.superquadrics.mesh(40, 28)
    rest = model.rest_params()
    shown = [drawn(model, parts, rest, turn) for turn in np.deg2rad((0, -40, -90, 180))]
    shown.append(drawn(model, parts, named_pose(model, "reach"), 0.4))
    shown.append(drawn(model, parts, named_pose(model, "lunge"), 1.0))
    shown.append(drawn(model, ellipsoid_mesh(model.ellipsoids["fine"], 3), rest, 0.0))
    return np.concatenate(shown, axis=1)


def drawn(model: ArticulatedModel, mesh: PartMesh, params: Floats[P], turn: float) -> Bytes[P]:
    """Return a picture of a mesh posed by params, turned about the vertical [rad], without perspective."""
    vertices, _ = mesh.carried(model.bones(params))
    c, s = np.cos(turn), np.sin(turn)
    seen = vertices @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
    corners = seen[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    width, height = _FINER * _SIZE[0], _FINER * _SIZE[1]
    picture = np.full((height, width, 3), 255, np.uint8)
    scale = _FINER * _PIXELS_PER_M
    flat = (width / 2, height / 2) + (corners[..., :2] - (0.0, _DOWN_M)) * (scale, -scale)
    pixels = np.round(flat * 2**_SUBPIXEL_BITS).astype(np.int32)
    for face in np.argsort(corners[..., 2].mean(axis=1)):
        if normal[face, 2] > 0:
            light = round(_SHADES * max(float(normal[face] @ _LIGHT), 0.0)) / _SHADES
            bright = 0.35 + 0.65 * light
            blue, green, red = (bright * _SKIN_BGR).tolist()
            cv2.fillConvexPoly(picture, pixels[face], (blue, green, red), 8, _SUBPIXEL_BITS)
    return np.asarray(cv2.resize(picture, _SIZE, interpolation=cv2.INTER_AREA), np.uint8)


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/figures/body34.png")
    cv2.imwrite(str(target), body_pictures(load_model("body34")), [cv2.IMWRITE_PNG_COMPRESSION, 9])
