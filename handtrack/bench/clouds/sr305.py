"""Benchmark: distances between model and cloud on eight real depth frames, each fitted without a first pose.

`handtrack bench sr305` prints the figures; `python -m handtrack.bench.clouds.sr305 FOLDER` also draws the fits. Both need
the shared test data (HANDTRACK_DATA).
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial import KDTree

from handtrack.arrays import D3, Array, Bytes, Floats, H, K, M, N, W
from handtrack.bench.measuring import data_folder
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.observation.observation import Observation
from handtrack.session.session import Session
from handtrack.simulation.render import pixel_rays, render
from handtrack.simulation.scenes.depth_hand import (
    CAMERA,
    as_image,
    hand_points,
    write_depth_session,
)
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.auto_start import auto_start
from handtrack.tracking.size.size import refine_scale
from handtrack.tracking.state import TrackerState
from handtrack.tracking.tracker import Tracker

_IMAGES = Path("sr305_depth_hand") / "20210326-230536"
_MM = 1e3
_EVERY_PX = 2  # of the model's picture, for its distance to the cloud


@dataclass(frozen=True, eq=False)
class DepthFit:
    """One frame's fit, and how good it is."""

    frame: int
    model: ArticulatedModel
    result: FrameResult
    hand: Floats[N, D3]
    """the hand's points, world [m]"""
    cloud_to_model_mm: Floats[N]
    """distance of each of them to the surface"""
    model_to_cloud_mm: Floats[M]
    """of the hand's surface that the camera sees, point by point, to the nearest measured one"""
    measured: Floats[K, D3]
    """everything measured, world [m]"""


@dataclass(frozen=True, eq=False)
class DepthFits:
    """The frames, with a mean adult's hand and with this person's."""

    mean_hand: list[DepthFit]
    own_hand: list[DepthFit]
    scale: HandScale


def fitted(frames: Sequence[int] | None = None) -> DepthFits:
    """Return fits of each frame (all unless named), found without any first pose.

    Each frame is found alone (`auto_start`); then one size of hand is fitted to all of them (overall: clouds from one
    side tell no more), and each frame again to that size. Raises HandtrackError without the data.
    """
    settings = TrackerSettings()
    with tempfile.TemporaryDirectory() as place:
        folder = write_depth_session(Path(place) / "sr305", data_folder() / _IMAGES)
        session = Session.open(folder)
        kept = frames or [f for f in session.frame_range if session.measured_cloud(f) is not None]
        seen = [session.observation(frame) for frame in kept]
        whole = replace(
            session.cloud_filters, voxel_m=None, outlier_neighbours=None, max_points=None
        )
        nearest = [session.cloud(frame, filters=whole)[0] for frame in kept]
        measured = [session.measured_cloud(frame) for frame in kept]

    def build(scale: HandScale) -> ArticulatedModel:
        return load_model(scale=scale, forearm=True)

    def fits(tracker: Tracker) -> list[DepthFit]:
        found = []
        for observation, start, near, every in zip(seen, starts, nearest, measured, strict=True):
            assert near is not None
            assert every is not None
            _, result = tracker.step(TrackerState.beginning_at(start), observation)
            hand = hand_points(near.points).points
            found.append(_measured(tracker.model, result, hand, every.points))
        return found

    starts = [_found(observation, settings) for observation in seen]
    scale = refine_scale(build, settings, HandScale(), seen, starts, parts=False)
    mean, own = (fits(Tracker(build(size), settings)) for size in (HandScale(), scale))
    return DepthFits(mean, own, scale)


def sr305() -> dict[str, Any]:
    """Return both distances [mm], mean and worst frame, for the mean hand and the fitted one, and the hand's size."""
    found = fitted()
    figures: dict[str, Any] = {"frames": len(found.own_hand)}
    for name, fits in (("own_hand", found.own_hand), ("mean_hand", found.mean_hand)):
        there = [float(fit.cloud_to_model_mm.mean()) for fit in fits]
        back = [float(fit.model_to_cloud_mm.mean()) for fit in fits]
        figures |= {
            f"{name}_cloud_to_model_mm": float(np.mean(there)),
            f"{name}_cloud_to_model_worst_mm": max(there),
            f"{name}_model_to_cloud_mm": float(np.mean(back)),
            f"{name}_model_to_cloud_worst_mm": max(back),
            f"{name}_by_frame": {
                fit.frame: f"{there[i]:.2f} and {back[i]:.2f} mm, {fit.result.status.name.lower()}"
                for i, fit in enumerate(fits)
            },
        }
    parts = {name: round(factor, 3) for name, factor in found.scale.parts.items()}
    return figures | {
        "scale": found.scale.overall,
        "parts": parts,
        "reference": "bars: 4 mm and 6 mm in each frame",
    }


def _found(seen: Observation, settings: TrackerSettings) -> Floats:
    """Return solver parameters (P,) of the hand with a forearm, found without a first pose."""
    models = [load_model(forearm=True)]
    best = auto_start(models, settings, seen)[0]
    return best.model.transform.solver_params(best.result.parameters)


def _measured(
    model: ArticulatedModel, result: FrameResult, hand: Floats, every: Floats
) -> DepthFit:
    bones = model.bones(model.transform.solver_params(result.parameters))
    there = np.abs(MetaballSurface.of(model).distance(bones, hand))
    back = KDTree(every).query(visible_surface(model, bones))[0]
    return DepthFit(result.frame, model, result, hand, there * _MM, back * _MM, every)


def visible_surface(model: ArticulatedModel, bones: BonePoses) -> Floats[M, D3]:
    """Return points, world [m], of the hand's merged surface, the forearm's left out, that the camera sees."""
    surface = MetaballSurface.of(model)
    posed = surface.ellipsoids.posed(bones)
    rays = pixel_rays(CAMERA)[::_EVERY_PX, ::_EVERY_PX]
    coarse = replace(CAMERA, size=(rays.shape[1], rays.shape[0]))
    front, depth, _ = render(coarse, posed, rays)
    hand = (front >= 0) & ~model.is_forearm(posed.bone[np.maximum(front, 0)])
    points = rays[hand] * depth[hand][:, None]
    return surface.projected(bones, points)


def overlay(fit: DepthFit, side: int = 320) -> Bytes[H, W, D3]:
    """Return a picture (side, 3 side, 3) BGR: the cloud with the model's outlines, the model, the cloud by distance.

    Green: on the surface; red: 10 mm and more off it.
    """
    bones = fit.model.bones(fit.model.transform.solver_params(fit.result.parameters))
    flesh = fit.model.flesh["fine"].posed(bones)
    front, _, normal = render(CAMERA, flesh, pixel_rays(CAMERA))
    grey = _painted(fit.measured, np.full((len(fit.measured), 3), 90.0))
    grey = _painted(fit.hand, np.full((len(fit.hand), 3), 150.0), grey)
    lit = 70 + 150 * np.clip(-normal[..., 2], 0, 1)
    shaded = np.where((front >= 0)[..., None], np.stack([lit * 0.6, lit * 0.8, lit], -1), grey)
    outlined = grey.copy()
    outlined[_borders(front, flesh.bone)] = (60, 200, 255)
    share = np.clip(fit.cloud_to_model_mm / 10.0, 0, 1)[:, None]
    by_distance = _painted(fit.hand, share * (60, 60, 255) + (1 - share) * (90, 220, 90), grey)
    middle = as_image(fit.hand.mean(axis=0)[None])[0] - side // 2
    x, y = (int(v) for v in np.clip(middle, 0, np.array(CAMERA.size) - side))
    parts = [p[y : y + side, x : x + side] for p in (outlined, shaded, by_distance)]
    picture = np.ascontiguousarray(np.hstack(parts).astype(np.uint8))
    text = (
        f"{fit.frame}: {fit.cloud_to_model_mm.mean():.1f} / {fit.model_to_cloud_mm.mean():.1f} mm"
    )
    cv2.putText(picture, text, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (255, 255, 255), 1)
    return picture


def _borders(front: Array, bone: Array) -> Array:
    """Return where another bone's ellipsoid begins (H, W)."""
    shown = np.where(front >= 0, bone[np.maximum(front, 0)], -1)
    border = np.zeros(front.shape, bool)
    border[:, 1:] |= shown[:, 1:] != shown[:, :-1]
    border[1:] |= shown[1:] != shown[:-1]
    return border


def _painted(points: Floats, colours: Floats, onto: Array | None = None) -> Array:
    picture = np.zeros((*CAMERA.size[::-1], 3)) if onto is None else onto.copy()
    pixels = as_image(points)
    inside = ((pixels >= 0) & (pixels < CAMERA.size)).all(axis=1)
    picture[pixels[inside, 1], pixels[inside, 0]] = colours[inside]
    return picture


def main(folder: Path) -> None:
    """Print the figures and draw every fit, each in a picture and all in one."""
    folder.mkdir(parents=True, exist_ok=True)
    found = fitted()
    print(found.scale)
    pictures = []
    for fit in found.own_hand:
        pictures.append(overlay(fit))
        cv2.imwrite(str(folder / f"sr305_{fit.frame:03d}.png"), pictures[-1])
        print(
            f"{fit.frame:4d}: cloud → model {fit.cloud_to_model_mm.mean():.2f} mm, model → cloud "
            f"{fit.model_to_cloud_mm.mean():.2f} mm, {fit.result.status.name.lower()} {fit.result.note}"
        )
    half = (len(pictures) + 1) // 2
    sheet = np.hstack([np.vstack(pictures[:half]), np.vstack(pictures[half:])])
    cv2.imwrite(
        str(folder / "sr305.png"),
        cv2.resize(sheet, None, fx=0.4, fy=0.4, interpolation=cv2.INTER_AREA),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
