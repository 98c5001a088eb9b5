"""Benchmark: distances between model and cloud on eight real depth frames, each fitted without a first pose.

Needs the shared test data (HANDTRACK_DATA). `python -m docs.pictures.depth_frames FOLDER` draws the fits.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from handtrack.arrays import D3, Floats, K, M, N
from handtrack.bench.measuring import data_folder
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.observation.observation import Observation
from handtrack.session.session import Session
from handtrack.simulation.render import pixel_rays, render
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.auto_start import auto_start
from handtrack.tracking.size.person import OpenPerson
from handtrack.tracking.state import TrackerState
from handtrack.tracking.tracker import Tracker
from handtrack.tracking.whole.chosen_frames import fit_person
from tests.experiments.scenes.depth_hand import (
    CAMERA,
    hand_points,
    write_depth_session,
)

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
    scale = fit_person(OpenPerson(build), build(HandScale()), settings, seen, starts)
    assert scale is not None, "clouds tell a size"
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
