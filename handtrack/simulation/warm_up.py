"""Frames of every kind, small and simulated: whoever tracks them has all of tracking compiled."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from handtrack.model.model_file import load_model
from handtrack.observation.observation import ImageKeypoints, Observation
from handtrack.simulation.scenes.simulated_clouds import Sensor, depth_views
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.state import TrackerState
from handtrack.tracking.tracker import Tracker

KINDS = ("silhouettes", "a point cloud", "joints in images", "several hypotheses")
_SIZE = (160, 120)


def warm_up() -> Iterator[str]:
    """Yield each of KINDS before a frame of it is tracked, searches included; what it found is thrown away."""
    model = load_model()
    pose = model.rest_params()
    pose[1] -= 0.09
    cameras = simulated_rig(2, _SIZE).cameras
    masks = mask_views(model, pose, cameras)
    cloud = next(
        depth_views(model, model.joint_params(pose)[None], Sensor(_SIZE), np.random.default_rng(0))
    )
    places = model.joint_positions(model.bones(pose))
    joints = tuple(ImageKeypoints(c, model.joint_names, c.project(places), 2.0) for c in cameras)
    seen = (
        masks,
        cloud,
        Observation(0, 0.0, keypoints=joints),
        Observation(0, 0.0, keypoints=joints[:1]),
    )
    settings: tuple[dict[str, object], ...] = (
        {},
        {"silhouettes.weight": 0.0},
        {},
        {"tracker.hypotheses": 2},
    )
    for kind, observation, values in zip(KINDS, seen, settings, strict=True):
        yield kind
        tracker = Tracker(model, TrackerSettings().with_values(values))
        tracker.step(TrackerState.beginning_at(pose), observation)
