"""A close picture of the hand in a camera's image: cut out and enlarged before the outline is drawn, so that this stays fine."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from handtrack.arrays import D3, Bytes, H, W
from handtrack.diagnostics.residual_image import OUTLINE, outline_polygons
from handtrack.geometry.camera import Camera
from handtrack.model.flesh import PosedEllipsoids

CLOSE_SIZE = (640, 480)
"""width and height [px]; the page's wall has room for that shape"""
_AIR = 1.5  # times what just fits
_MOST = 12.0  # times enlarged at most, as in a view through a camera
_THICK = 2  # [px] of the outline


def close_up(
    image: Bytes[H, W, D3], camera: Camera, flesh: PosedEllipsoids, aside: int | None = None
) -> Bytes[H, W, D3]:
    """Return the part of an undistorted image RGB that shows a model with its outline, `CLOSE_SIZE` large; all of it where none is before the camera.

    aside: a bone that may be cut off, a hand's forearm.
    """
    factor, left, top = _part(camera, flesh, aside)
    shift = np.array([[factor, 0, -factor * left], [0, factor, -factor * top]])
    way = cv2.INTER_CUBIC if factor > 1 else cv2.INTER_AREA
    close = cv2.warpAffine(image, shift, CLOSE_SIZE, flags=way, borderValue=(26, 26, 26))
    picture = np.ascontiguousarray(close, np.uint8)
    matrix = camera.matrix.copy()
    matrix[0, 0], matrix[1, 1] = factor * matrix[0, 0], factor * matrix[1, 1]
    matrix[:2, 2] = factor * (matrix[:2, 2] - (left, top))
    near = replace(camera.without_distortion(), size=CLOSE_SIZE, matrix=matrix)
    lines = [np.rint(line).astype(np.int32)[:, None] for line in outline_polygons(near, flesh)]
    cv2.polylines(picture, lines, True, OUTLINE, _THICK, cv2.LINE_AA)
    return picture


def _part(camera: Camera, flesh: PosedEllipsoids, aside: int | None) -> tuple[float, float, float]:
    """Return the enlargement, and the column and row [px] of the part's upper left pixel."""
    seen = flesh.centre @ camera.rotation.T + camera.translation
    reach = flesh.radii.max(axis=1)
    ahead = (seen[:, 2] > reach) & (flesh.bone != (-1 if aside is None else aside))
    wide, high = camera.size
    low, high_corner = np.zeros(2), np.array([wide, high], float)
    if ahead.any():
        depth = seen[ahead, 2:]
        pixels = (seen[ahead] / depth) @ camera.matrix[:2].T
        around = reach[ahead, None] / depth * np.diag(camera.matrix)[:2]
        low, high_corner = (pixels - around).min(axis=0), (pixels + around).max(axis=0)
    size = np.maximum(high_corner - low, 1.0)
    least = min(CLOSE_SIZE[0] / wide, CLOSE_SIZE[1] / high)
    factor = min(CLOSE_SIZE[0] / size[0], CLOSE_SIZE[1] / size[1]) / (_AIR if ahead.any() else 1.0)
    factor = float(np.clip(factor, least, _MOST * least))
    middle = np.clip((low + high_corner) / 2, 0, (wide, high))
    left, top = middle - np.array(CLOSE_SIZE) / 2 / factor
    return factor, float(left), float(top)
