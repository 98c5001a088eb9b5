"""The largest connected piece of a mask that no part of the model covers: a finger that is elsewhere, not a rim."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from handtrack.arrays import Array, C, Floats, H, Ints, N, W
from handtrack.geometry.quadric import dual_conic, ellipse, is_ellipse, shape_matrix
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.terms.silhouettes.prepared_silhouette import PreparedSilhouette

THICK_M = (
    0.010  # thinner is a rim by which a mask is wider than the model, or the model another person's
)
_FRACTION = 4  # bits of a pixel that OpenCV draws ellipses to


def unexplained_mm2(
    silhouettes: Sequence[PreparedSilhouette],
    pixels_per_m: Sequence[float],
    ellipsoids: Ellipsoids,
    bones: BonePoses,
) -> Floats[C]:
    """Return the area [mm²] of the largest connected piece of each mask beside the model, at the hand's distance.

    It is what circles of 10 mm can sweep: a rim is thinner, a finger that the model has elsewhere is not, however small its
    share of the overlap. What is not observed or not known counts as covered.
    """
    posed = ellipsoids.posed(bones)
    found = np.zeros(len(silhouettes))
    for row, (silhouette, scale) in enumerate(zip(silhouettes, pixels_per_m, strict=True)):
        left = _mask(silhouette) & ~_covered(silhouette, posed)
        if left.any():
            _, areas = pieces(left, 0.5 * THICK_M * scale)
            found[row] = areas.max(initial=0.0) * (1e3 / scale) ** 2
    return found


def pieces(left: Array[H, W], radius: float) -> tuple[Ints[H, W], Floats[N]]:
    """Return the connected pieces that circles of a radius [px] sweep, numbered from 1, and their areas [px]."""
    middle = (
        cv2.distanceTransform(np.pad(left, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        >= radius
    )
    if not middle.any():
        return np.zeros(left.shape, np.int32), np.zeros(0)
    away = cv2.distanceTransform((~middle).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    labels, about = cv2.connectedComponentsWithStats((away <= radius).astype(np.uint8))[1:3]
    labels, areas = labels[1:-1, 1:-1], about[1:, cv2.CC_STAT_AREA].astype(float)
    return np.asarray(labels, np.int32), areas


def _mask(silhouette: PreparedSilhouette) -> Array[H, W]:
    """Return where the mask surely shows the hand."""
    width, height = silhouette.camera.size
    mask = silhouette.mask
    begins = np.zeros(len(mask.ends), np.int64)
    begins[1:] = mask.ends[:-1]
    begins[mask.begins[:-1]] = 0
    values = np.repeat(mask.values, mask.ends - begins).reshape(height, width)
    column = np.arange(width)
    observed = (column >= mask.valid[:, :1]) & (column < mask.valid[:, 1:])
    return observed & (values < -0.5)


def _covered(silhouette: PreparedSilhouette, ellipsoids: Ellipsoids) -> Array[H, W]:
    """Return where a camera sees the model."""
    camera = silhouette.camera
    shape = shape_matrix(ellipsoids.rotation, ellipsoids.radii)
    dual = dual_conic(camera.projection, ellipsoids.centre, shape)
    seen = is_ellipse(camera.projection, ellipsoids.centre, shape)
    centre, spread = ellipse(dual[seen])
    image = np.zeros(camera.size[::-1], np.uint8)
    for middle, part in zip(centre, spread, strict=True):
        squares, axes = np.linalg.eigh(part)
        if squares[0] <= 0:
            continue
        turn = float(np.rad2deg(np.arctan2(axes[1, 1], axes[0, 1])))
        at, half = ((1 << _FRACTION) * np.array([middle, np.sqrt(squares[::-1])])).round()
        if np.abs([at, half]).max() < 1 << 28:
            cv2.ellipse(
                image,
                at.astype(int).tolist(),
                half.astype(int).tolist(),
                turn,
                0,
                360,
                1,
                -1,
                cv2.LINE_8,
                _FRACTION,
            )
    return image > 0
