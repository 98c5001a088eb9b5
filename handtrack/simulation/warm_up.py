"""Frames of every kind, small and simulated: whoever tracks and refines them has all of tracking compiled."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace

from handtrack.arrays import Floats
from handtrack.capture.clouds.point_cloud import depth_cloud
from handtrack.geometry.rotation import spread_rotations
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model
from handtrack.observation.observation import ImageKeypoints, Observation
from handtrack.parallel import thread_count
from handtrack.simulation.render import render
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.global_search import GlobalObjective
from handtrack.tracking.search.scores import shape_of
from handtrack.tracking.sequence import track_recording
from handtrack.tracking.size.person import Subject
from handtrack.tracking.tracker import Tracker

# the settings that each kind is tracked with, the longest to compile first
KINDS: dict[str, dict[str, object]] = {
    "silhouettes": {},
    "several hypotheses": {"tracker.hypotheses": 2, "tracker.estimate": "forward"},
    "a point cloud": {"silhouettes.weight": 0.0},
    "joints in images": {},
}
_SIZE = (160, 120)


def warm_up() -> Iterator[str]:
    """Yield each of KINDS when a frame of it was tracked, searches included; what it found is thrown away.

    Numba compiles in one thread of a process, so the kinds share the cores as processes, and meet in its cache.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(thread_count(), len(KINDS)), context) as pool:
        for done in as_completed([pool.submit(track_small_frame, kind) for kind in KINDS]):
            yield done.result()


def track_small_frame(kind: str) -> str:
    """Track a simulated frame of one of KINDS three times, refine the three, and score a pose as searches do; return the kind."""
    model = load_model()
    pose = model.rest_params()
    pose[1] -= 0.09
    settings, seen = TrackerSettings().with_values(KINDS[kind]), _observation(kind, model, pose)
    tracker = Tracker(model, settings, subject=Subject(lambda size: load_model(scale=size)))

    def observe(frame: int, _: BonePoses | None = None) -> Observation:
        return replace(seen, frame=frame, time_s=frame / 30.0)

    list(track_recording(tracker, observe, 0, pose, range(3)))
    if objective := GlobalObjective.of(seen, settings):
        (source, *_), turns = objective.sources, spread_rotations(1)
        source.scores(shape_of(model, pose, "open"), turns, source.places[:1])
    return kind


def _observation(kind: str, model: ArticulatedModel, pose: Floats) -> Observation:
    cameras = simulated_rig(2, _SIZE).cameras
    if kind == "silhouettes":
        return mask_views(model, pose, cameras)
    if kind == "a point cloud":
        depth = render(cameras[0], model.ellipsoids["metaballs"].posed(model.bones(pose)))[1]
        cloud = depth_cloud(cameras[0], depth)
        return Observation(0, 0.0, cloud=cloud, cloud_views=(cameras[0].centre[None],))
    if kind == "several hypotheses":  # from one camera, whose depth stays open
        cameras = cameras[:1]
    places = model.joint_positions(model.bones(pose))
    joints = tuple(ImageKeypoints(c, model.joint_names, c.project(places), 2.0) for c in cameras)
    return Observation(0, 0.0, keypoints=joints)
