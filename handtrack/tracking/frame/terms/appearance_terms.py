"""What a frame's images contribute by themselves: edges on the outline, and the texture of the frame before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from functools import lru_cache

import cv2
import numpy as np

from handtrack.arrays import Array, Floats, Ints, array_dataclass
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.metaballs import model_mesh
from handtrack.model.part_mesh import PartMesh
from handtrack.observation.observation import ImageView, Observation
from handtrack.terms.images import (
    CarriedTextureTerm,
    OutlineEdgesTerm,
    Texture,
    contradicts,
    depth_picture,
    edges_near,
    exposed_as,
    outline_points,
    smooth_image,
    still_visible,
    texture_points,
)
from handtrack.terms.loss import geman_mcclure
from handtrack.terms.term import ObservationTerm
from handtrack.tracking.frame.constants import (
    EDGE_SEARCH_PX,
    FOREARM_VISIBLE_MM,
    TEXTURE_CORRELATION_PX,
    TEXTURE_SMOOTH_PX,
)
from handtrack.tracking.frame.settings import TrackerSettings

_MM = 1e-3
_STEP = 0.5  # of a thin part's radius: what is that much further behind shows an edge
_SIGMAS = 3.0  # of an edge's place, within the search
# sigmas; another colour is another thing, or, at first, still the wrong place
_ROBUST = (12.0, 6.0, 3.0)
_SPACING_PX = 3  # between points of texture
_BORDER_PX = 2  # of the model, where the colour may be the background's
_SAME, _SAME_PX = 4.0, 2.0  # sigmas within which a colour is the same, images smoothed by that much
_LEAST_SMOOTHING_PX = 0.8  # of images in which edges are looked for


@array_dataclass
class Before:
    """A frame that is solved already."""

    observation: Observation
    bones: BonePoses
    """where the model was found in it"""
    first: Before | None = None
    """the frame that tracking started from, where its pose was given"""


@array_dataclass
class CarriedPoints:
    """Points of the surface that one camera saw in a frame before."""

    share: float
    """of the weight"""
    camera: Camera
    """of this frame's image"""
    pixels: Array
    """that frame's image"""
    bone: Ints
    local: Floats
    pixel: Floats
    spacing_m: float
    """about how far the points are from each other"""

    _textures: dict[float, Texture] = field(init=False, repr=False, default_factory=dict)
    """by smoothing: all hypotheses of a frame look at the same"""

    def texture(self, smoothing_px: float) -> Texture:
        """Return the points with the colours that the smoothed image has there."""
        if smoothing_px not in self._textures:
            image = smooth_image(self.pixels, smoothing_px, self.pixel)
            colours = image.look_up(self.pixel)
            self._textures[smoothing_px] = Texture(self.camera, self.bone, self.local, colours)
        return self._textures[smoothing_px]


def carried_points(
    seen: Observation, model: ArticulatedModel, settings: TrackerSettings, before: Before | None
) -> tuple[CarriedPoints, ...] | None:
    """Return the points whose texture is looked for in a frame's images; None without images, or where neither edges nor intensity count."""
    by_edges, by_texture = settings.edges.weight > 0, settings.intensity.weight > 0
    if not seen.images or not (by_edges or (by_texture and before is not None)):
        return None
    carried: list[CarriedPoints] = []
    if by_texture and before is not None:
        first, memory = before.first, settings.intensity.memory
        memory = 0.0 if first is None else memory
        last = _carried(model, before, seen.images, 1.0 - memory)
        if first is not None and memory > 0:
            known = _carried(model, first, seen.images, memory)
            last = [_agreeing(c, known, settings) for c in last]
            carried += known
        carried += last if memory < 1 else []
    return tuple(carried) if by_edges or carried else None


def appearance_terms(
    model: ArticulatedModel,
    images: Sequence[ImageView],
    carried: Sequence[CarriedPoints],
    settings: TrackerSettings,
    stage: int,
    start: BonePoses,
) -> list[ObservationTerm]:
    """Return edges and texture of one stage; what is visible, and which edges are near, is frozen at `start`."""
    mesh, step_m = _looked_at(model), _step_m(model)
    views = [(view, depth_picture(mesh, start, view.camera)) for view in images]
    # whether costs of different poses are held against each other, each with what it shows of the model
    compared = settings.tracker.hypotheses > 1
    terms: list[ObservationTerm] = []
    if settings.edges.weight > 0:
        search = at_stage(EDGE_SEARCH_PX, stage)
        smoothing = max(_LEAST_SMOOTHING_PX, search / 8.0)
        found = []
        for view, picture in views:
            outline = outline_points(mesh, start, picture, step_m)
            image = smooth_image(view.pixels, smoothing, outline.pixel, search + 2.0)
            found.append(edges_near(outline, image, search))
        sigma = max(search / _SIGMAS, settings.edges.sigma_px)
        weight = settings.edges.weight
        terms.append(
            OutlineEdgesTerm(found, sigma_px=sigma, weight=weight, from_unexplained=compared)
        )
    smoothing, robust = at_stage(TEXTURE_SMOOTH_PX, stage), geman_mcclure(at_stage(_ROBUST, stage))
    share = min(1.0, (_SPACING_PX / max(TEXTURE_CORRELATION_PX, smoothing)) ** 2)
    for points in carried:
        view, picture = next(one for one in views if one[0].camera is points.camera)
        texture = still_visible(points.texture(smoothing), start, picture, step_m)
        at = points.camera.project(start.to_world(texture.bone, texture.local))
        now = smooth_image(view.pixels, smoothing, at, 8.0 + 4.0 * smoothing)
        terms.append(
            CarriedTextureTerm(
                [(exposed_as(texture, start, now), now)],
                settings.intensity.sigma,
                robust,
                weight=settings.intensity.weight * points.share * share,
                from_unexplained=compared,
            )
        )
    return terms


def appearance_stages(settings: TrackerSettings) -> int:
    """Return how many stages the schedule of edges and texture has."""
    return max(
        len(EDGE_SEARCH_PX) if settings.edges.weight > 0 else 1,
        len(TEXTURE_SMOOTH_PX) if settings.intensity.weight > 0 else 1,
    )


def at_stage(values: Sequence[float], stage: int) -> float:
    """Return a stage's value; the last one holds for all that follow."""
    return values[min(stage, len(values) - 1)]


def _carried(
    model: ArticulatedModel, before: Before, images: Sequence[ImageView], share: float
) -> list[CarriedPoints]:
    """Return the surface points that each camera saw in an earlier frame, but not those next to the background."""
    now, mesh = {view.camera.name: view.camera for view in images}, _looked_at(model)
    found = []
    for view in before.observation.images:
        if view.camera.name not in now:
            continue
        picture = depth_picture(mesh, before.bones, view.camera)
        on_model = np.pad((picture.face >= 0).astype(np.uint8), 1)
        size = 2 * _BORDER_PX + 1
        inner = cv2.erode(on_model, np.ones((size, size), np.uint8))[1:-1, 1:-1]
        picture = replace(picture, face=np.where(inner > 0, picture.face, -1))
        points = texture_points(mesh, before.bones, picture, _SPACING_PX)
        depth = picture.depth[np.isfinite(picture.depth)]
        far = float(np.median(depth)) if len(depth) else 0.0
        spacing = _SPACING_PX * far / float(view.camera.matrix[0, 0])
        camera = now[view.camera.name]
        found.append(CarriedPoints(share, camera, view.pixels, *points, spacing))
    return found


def _agreeing(
    carried: CarriedPoints, known: Sequence[CarriedPoints], settings: TrackerSettings
) -> CarriedPoints:
    """Return the points without those that the first frame showed in another colour.

    There the model was not on what it should be on: carried further, they would hold it where it slipped to.
    """
    same = [k for k in known if k.camera is carried.camera]
    if not same:
        return carried
    first = same[0]
    tolerance = _SAME * np.sqrt(3.0) * settings.intensity.sigma  # all three channels
    now, then = carried.texture(_SAME_PX), first.texture(_SAME_PX)
    kept = ~contradicts(now, then, first.spacing_m, tolerance)
    return replace(
        carried, bone=carried.bone[kept], local=carried.local[kept], pixel=carried.pixel[kept]
    )


def _step_m(model: ArticulatedModel) -> float:
    """Return how far apart in depth parts must be for an edge between them to show [m]."""
    return _STEP * float(np.median(model.ellipsoids["fine"].radii.min(axis=1)))


@lru_cache(maxsize=8)
def _looked_at(model: ArticulatedModel) -> PartMesh:
    """Return the model's mesh without the far end of the forearm, where there may be a sleeve."""
    mesh = model_mesh(model)
    return mesh.subset(~model.is_forearm(mesh.bone) | (mesh.local[:, 1] < FOREARM_VISIBLE_MM * _MM))
