"""Predicted images of a silhouette term and their difference to the mask, as arrays and pictures.

Blue: the model covers, the mask does not; or the way from a joint that was seen to the model's. Orange: the mask, not the model; or a joint. Both are told apart by colour-blind eyes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import cv2
import numpy as np

from handtrack.arrays import D2, D3, Array, Bytes, Floats, H, J, N, W
from handtrack.geometry.camera import Camera
from handtrack.model.ellipsoids import Ellipsoids, field_image, model_mask
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import ImageKeypoints, Silhouette
from handtrack.terms.clouds import CloudDistanceTerm, CloudEmptinessTerm, CloudRaysTerm
from handtrack.terms.images import CarriedTextureTerm, OutlineEdgesTerm
from handtrack.terms.own_time import AtOwnTime
from handtrack.terms.silhouettes import THICK_M, ConicFieldTerm, CoverageTerm, pieces
from handtrack.terms.term import ObservationTerm

MODEL_ONLY = (0, 114, 178)
MASK_ONLY = (230, 159, 0)
HAND_TINT, UNKNOWN_TINT = (0, 158, 115), (204, 121, 167)
_FILL, _HATCH = 0.4, 8
"""of a mask's pictures: how opaque, and pixels from one line to the next"""
DOT = (
    1 / 600
)  # half a dot's radius, of the image's longer side: seen on a thumbnail, and smaller than a detector's error
OUTLINE = (255, 194, 10)
_LETTER_PX, _LEAST = 22, 0.3
"""height of OpenCV's letters at size 1, and the least size at which they are read"""


def predicted_image(
    term: ConicFieldTerm | CoverageTerm, index: int, bones: BonePoses
) -> Floats[H, W]:
    """Return P of a term's silhouette number `index`."""
    ellipsoids, field = term.ellipsoids.posed(bones), term.fields[index]
    camera = term.silhouettes[index].camera
    image = field_image(camera, ellipsoids, field.levels, field.depth_scaled)
    return np.maximum(image, -field.limit)


def residual_image(predicted: Floats[H, W], mask: Array[H, W]) -> Floats[H, W]:
    """Return P − Z for Z = −mask: negative where only the model is, positive where only the mask is."""
    return predicted + mask


def residual_picture(
    image: Bytes[H, W, D3], camera: Camera, ellipsoids: Ellipsoids, mask: Array[H, W]
) -> Bytes[H, W, D3]:
    """Return the picture RGB with the disagreement of hard outline and mask painted over it, and pieces of the mask beside the
    model outlined, with their area at the model's distance.
    """
    model = model_mask(camera, ellipsoids)
    residual = np.where(mask < 0, 0.0, mask - model.astype(float))
    differs = residual != 0.0  # a small part of a large image
    share = 0.75 * np.abs(residual[differs])[:, None]
    end = np.where(residual[differs][:, None] < 0, np.array(MODEL_ONLY), np.array(MASK_ONLY))
    here, picture = image[differs].astype(float), image.copy(order="C")
    picture[differs] = np.rint(here + share * (end - here)).astype(np.uint8)
    away = np.median((ellipsoids.centre - camera.centre) @ camera.rotation[2])
    scale = camera.matrix[0, 0] / max(float(away), 1e-6)
    labels, areas = pieces((mask > 0.5) & ~model, 0.5 * THICK_M * scale)
    # letters as high as half a finger is thick: a view that follows the model enlarges them with it
    size = max(min(0.5 * THICK_M * scale / _LETTER_PX, max(mask.shape) / 1000), _LEAST)
    for number, area in enumerate(areas, start=1):
        lines, _ = cv2.findContours(
            (labels == number).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        cv2.drawContours(picture, lines, -1, OUTLINE, 2)
        x, y, _, _ = cv2.boundingRect(lines[0])
        words = f"{area * (1e3 / scale) ** 2:.0f} sq mm"
        for colour, thick in (((0, 0, 0), 2), (OUTLINE, 1)):
            cv2.putText(
                picture,
                words,
                (x, max(y - 6, 12)),
                cv2.FONT_HERSHEY_SIMPLEX,
                size,
                colour,
                thick,
                cv2.LINE_AA,
            )
    return picture


def joint_pairs(
    seen: ImageKeypoints, names: Sequence[str], places: Floats[J, D3]
) -> Floats[N, D2, D2]:
    """Return where a camera's joints were seen and where the model has them [px], of those that
    both have.

    Parameters
    ----------
    names, places
        Of the model's joints, world [m].
    """
    known = [i for i, name in enumerate(seen.names) if name in names]
    known = [i for i in known if np.isfinite(seen.pixels[i]).all()]
    there = places[[names.index(seen.names[i]) for i in known]].reshape(-1, 3)
    return np.stack([seen.pixels[known].reshape(-1, 2), seen.camera.project(there)], axis=1)


def joints_picture(image: Bytes[H, W, D3], pairs: Floats[N, D2, D2]) -> Bytes[H, W, D3]:
    """Return the picture RGB with a dot where each joint was seen, and a line from there to where the model has it."""
    picture = np.ascontiguousarray(image).copy()
    size = max(round(max(image.shape[:2]) * DOT), 1)
    for seen, there in np.rint(pairs).astype(int)[np.isfinite(pairs).all(axis=(1, 2))]:
        cv2.line(picture, seen.tolist(), there.tolist(), MODEL_ONLY, size, cv2.LINE_AA)
        cv2.circle(picture, seen.tolist(), 2 * size, MASK_ONLY, -1, cv2.LINE_AA)
    return picture


def mask_picture(image: Bytes[H, W, D3], silhouette: Silhouette) -> Bytes[H, W, D3]:
    """Return the picture RGB with the hand filled translucently, what is unknown hatched, and the border drawn."""
    hand, known = silhouette.mask > 0.5, silhouette.known
    rows, columns = np.nonzero(~known)
    dark = (rows + columns) % _HATCH < _HATCH // 2
    picture = image.copy(order="C")
    for where, tint in ((hand, HAND_TINT), ((rows[dark], columns[dark]), UNKNOWN_TINT)):
        here = picture[where].astype(float)
        picture[where] = np.rint(here + _FILL * (np.array(tint) - here)).astype(np.uint8)
    lines, _ = cv2.findContours(hand.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, lines, -1, HAND_TINT, 1)
    return picture


def outline_polygons(camera: Camera, ellipsoids: Ellipsoids) -> list[Floats[N, D2]]:
    """Return the model's outlines, holes too, in pixels of the undistorted camera."""
    mask = model_mask(camera, ellipsoids).astype(np.uint8)
    found, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    return [np.asarray(line, dtype=float).reshape(-1, 2) for line in found]


def outline_picture(
    image: Bytes[H, W, D3], camera: Camera, ellipsoids: Ellipsoids, width: int = 1
) -> Bytes[H, W, D3]:
    """Return the picture RGB with the model's outline drawn over it. width: of the line [px]."""
    picture = np.ascontiguousarray(image).copy()
    lines = [
        np.rint(line).astype(np.int32)[:, None] for line in outline_polygons(camera, ellipsoids)
    ]
    cv2.polylines(picture, lines, True, OUTLINE, width, cv2.LINE_AA)
    return picture


def field_picture(camera: Camera, ellipsoids: Ellipsoids) -> Bytes[H, W, D3]:
    """Return the normalised field as a picture RGB, dark outside, brightest at the ellipses' centres."""
    depth = np.rint(-255 * field_image(camera, ellipsoids)).astype(np.uint8)
    colors = cv2.applyColorMap(depth, cv2.COLORMAP_VIRIDIS)[..., ::-1]
    return np.where(depth[..., None] > 0, colors, 24).astype(np.uint8)


# ---- Where in space or in an image a term's residuals are, signed, in standard deviations. Positive: something was observed that
# the model does not reach or is darker than; negative: the model is where nothing was observed


def space_residuals(
    term: ObservationTerm, bones: BonePoses
) -> Iterator[tuple[str, Floats[N, D3], Floats[N]]]:
    """Yield `cloud`, its points (world [m]) and E1's signed distances of them; or `empty` and E2's, of the model's surface where the
    cloud is empty.
    """
    if isinstance(term, AtOwnTime):
        yield from space_residuals(term.term, term.motion_there.carried(bones))
    elif isinstance(term, CloudDistanceTerm):
        points = term.cloud.rows
        yield "cloud", points, term.surface.distance(bones, points) / term.sigma_m
    elif isinstance(term, CloudRaysTerm):
        yield "cloud", term.points, term.surface.distance(bones, term.points) / term.along_m
    elif isinstance(term, CloudEmptinessTerm):
        points = bones.to_world(term.bone, term.local)
        beyond = np.maximum(term.distances.at(points)[0] - term.slack_m, 0.0)
        yield "empty", points, -beyond / term.sigma_m


def image_residuals(
    term: ObservationTerm, bones: BonePoses
) -> Iterator[tuple[str, Camera, Floats[N, D2], Floats[N]]]:
    """Yield `edges` or `texture`, a camera, its pixels, and how far the edge that each piece of outline explains is out along its normal; or how much brighter
    than the carried texture the image is. A piece without an edge on its normal is left out.
    """
    if isinstance(term, OutlineEdgesTerm):
        for outline, place, strength in term.observed:
            at = bones.to_world(outline.bone, outline.local)
            pixels = outline.camera.project(at)
            moved = ((pixels - outline.pixel) * outline.normal).sum(axis=1)
            off = place - moved[:, None]
            share = strength * np.exp(-0.5 * (off / term.sigma_px) ** 2)
            nearest = off[np.arange(len(off)), share.argmax(axis=1)] / term.sigma_px
            there = (share > 0.0).any(axis=1)
            yield "edges", outline.camera, pixels[there], nearest[there]
    elif isinstance(term, CarriedTextureTerm):
        for texture, image in term.observed:
            at = bones.to_world(texture.bone, bones.rescaled(texture.bone, texture.local))
            pixels = texture.camera.project(at)
            brighter = (image.look_up(pixels) - texture.color).mean(axis=1)
            yield "texture", texture.camera, pixels, brighter / term.sigma


def dots(size: tuple[int, int], pixels: Floats[N, D2], values: Floats[N]) -> Floats[H, W]:
    """Return a picture (width, height) of small squares with the values, the largest on top; NaN elsewhere."""
    reach = max(round(max(size) * DOT), 1)
    square = np.array([*product(range(-reach, reach + 1), repeat=2)])
    order = np.argsort(np.abs(values))
    places = np.rint(pixels[order, None]) + square
    inside = ((places >= 0) & (places < size)).all(axis=2)
    u, v = places[inside].astype(int).T
    width, height = size
    picture = np.full((height, width), np.nan)
    picture[v, u] = np.repeat(values[order], inside.sum(axis=1))
    return picture
