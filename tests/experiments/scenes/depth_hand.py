"""Read eight real depth frames of an open hand and pick the hand's points from depth alone."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.spatial import KDTree

from handtrack.arrays import D2, D3, Array, Floats, Ints, K, N
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera, CameraRig
from handtrack.session.layout import CALIBRATION_FILE, SESSION_FILE

CAMERA = Camera(
    "sr305",
    (640, 480),
    np.array([[476.007, 0.0, 313.683], [0.0, 476.007, 242.755], [0.0, 0.0, 1.0]]),
    np.zeros(5),
    np.eye(3),
    np.zeros(3),
)
UNIT_M = 0.000125
"""metres in one unit of the files"""
AROUND_TIP_M = 0.12
"""A point is the hand's if the fingertip nearest to it is at most that far: fingers and palm, hardly any forearm."""
_SESSION = f"""[session]
format = 1
name = "sr305"
fps = 1.0

[hand]
scale = "fit"

[[camera]]
name = "sr305"
depth = "depth/*.png"
depth_scale_m = {UNIT_M}

[clouds]
depth = ["sr305"]
near_m = 0.2
front_m = 0.12
"""
_DISC_M = 0.013  # its radius; adults' fingers are 15 to 22 mm wide
_LEAST_FINGER_M = 0.025
_AROUND_PX = 2


@dataclass(frozen=True, eq=False)
class HandPoints:
    """The hand in one depth image."""

    points: Floats[N, D3]
    """world [m], all pixels of it"""
    tips: Floats[K, D3]
    """(T, 3) its fingertips"""


def write_depth_session(folder: Path, images: Path) -> Path:
    """Write a session of the 16 bit images (N.png) of this camera into a folder; return it."""
    (folder / "depth").mkdir(parents=True)
    for file in images.glob("*.png"):
        shutil.copyfile(file, folder / "depth" / file.name)
    write_rig(folder / CALIBRATION_FILE, CameraRig((CAMERA,)))
    (folder / SESSION_FILE).write_text(_SESSION)
    return folder


def hand_points(points: Floats[N, D3]) -> HandPoints:
    """Return the hand among the points, world [m], of the part nearest to the camera; no model is looked at.

    In the picture of these points, fingers are what a disc as wide as a finger and a half does not fit into, if it is
    long enough; a fingertip is its end.
    """
    pixels = as_image(points)
    inside = ((pixels >= 0) & (pixels < CAMERA.size)).all(axis=1)
    columns, rows = pixels[inside].T
    seen = np.zeros(CAMERA.size[::-1], bool)
    seen[rows, columns] = True
    pixel_m = float(np.median(points[:, 2])) / CAMERA.matrix[0, 0]
    whole = np.asarray(ndimage.binary_fill_holes(np.pad(seen, _AROUND_PX)))
    wide = np.asarray(ndimage.distance_transform_edt(whole)) > _DISC_M / pixel_m
    away = ndimage.distance_transform_edt(~wide) * pixel_m - _DISC_M  # from where the disc fits
    parts: Ints = np.zeros(whole.shape, np.int32)
    ndimage.label(whole & (away > 0), output=parts)  # pyright: ignore[reportArgumentType]
    ends = ndimage.maximum_position(away, parts, range(1, int(parts.max()) + 1))
    tips = np.array([e for e in ends if away[e] > _LEAST_FINGER_M]).reshape(-1, 2) - _AROUND_PX
    if len(tips) == 0:
        raise HandtrackError("no finger in the picture of the points nearest to the camera.")
    place = np.full((*seen.shape, 3), np.nan)
    place[rows, columns] = points[inside]
    ends_m = place[tuple(tips.T)]
    ends_m = ends_m[np.isfinite(ends_m).all(axis=1)]
    near = KDTree(ends_m).query(points)[0] <= AROUND_TIP_M
    return HandPoints(points[near], ends_m)


def as_image(points: Floats[N, D3]) -> Array[N, D2]:
    """Return the pixels of points in the camera, rounded."""
    return np.rint(CAMERA.project(points)).astype(int)
