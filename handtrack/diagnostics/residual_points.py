"""Where in space or in an image a term's residuals are, signed, in standard deviations: what a picture of them shows.

Positive: something was observed that the model does not reach or is darker than; negative: the model is where nothing was observed.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from handtrack.arrays import D2, D3, Floats, H, N, W
from handtrack.diagnostics.residual_image import DOT
from handtrack.geometry.camera import Camera
from handtrack.model.kinematics import BonePoses
from handtrack.terms.clouds.cloud_distance import CloudDistanceTerm
from handtrack.terms.clouds.cloud_emptiness import CloudEmptinessTerm
from handtrack.terms.clouds.cloud_rays import CloudRaysTerm
from handtrack.terms.images.carried_texture import CarriedTextureTerm
from handtrack.terms.images.outline_edges import OutlineEdgesTerm
from handtrack.terms.own_time import AtOwnTime
from handtrack.terms.term import ObservationTerm


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
            brighter = (image.look_up(pixels)[0] - texture.color).mean(axis=1)
            yield "texture", texture.camera, pixels, brighter / term.sigma


def dots(size: tuple[int, int], pixels: Floats[N, D2], values: Floats[N]) -> Floats[H, W]:
    """Return a picture (width, height) of small squares with the values, the largest on top; NaN elsewhere."""
    width, height = size
    reach = max(round(max(size) * DOT), 1)
    high, low = np.full((height, width), -np.inf), np.full((height, width), np.inf)
    shown = np.isfinite(pixels).all(axis=1)
    (u, v), values = np.rint(pixels[shown]).astype(np.int64).T, values[shown]
    for du, dv in product(range(-reach, reach + 1), repeat=2):
        inside = (u + du >= 0) & (v + dv >= 0) & (u + du < width) & (v + dv < height)
        place = (v + dv)[inside], (u + du)[inside]
        np.maximum.at(high, place, values[inside])
        np.minimum.at(low, place, values[inside])
    return np.where(np.isinf(high), np.nan, np.where(high > -low, high, low))
