"""A size that too little of the hand was measured for is held at the population's, and what is stated says so."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from handtrack.model.articulated import HandScale, keypoint_names
from handtrack.model.model_file import load_model
from handtrack.model.size import POPULATION_SIGMA, hand_length_mm
from handtrack.observation.observation import ImageKeypoints, Observation
from handtrack.session.run import size_of_frames, tracked_for_size, who_is_open
from handtrack.simulation.motion import motion
from handtrack.simulation.scenes.simulated_clouds import Sensor, depth_views
from handtrack.tracking.frame.doubt.judgement import Judgement, judged
from handtrack.tracking.frame.frame_result import posed_result
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.state import TrackerState
from handtrack.tracking.tracker import Tracker
from tests.tracking.test_shared_cameras import camera_at, waving_poses

MEAN = load_model("hand26")
SMALL = HandScale(0.67)
POSES = motion(MEAN, "open_fist_open", 100, np.random.default_rng(0))[:2]


def run_of(scale: HandScale, observations, first=None) -> SimpleNamespace:
    """Return what of a run a fit of the size asks for."""

    def with_scale(size: HandScale) -> SimpleNamespace:
        return run_of(size, observations, first)

    return SimpleNamespace(
        model=load_model("hand26", scale=scale), settings=TrackerSettings(), scale=scale, first=first, with_scale=with_scale,
        seen_at=lambda result: observations[result.frame], sees_joints=False, offsets_are_open=False, known_person=None, size_is_open=True,
        session=SimpleNamespace(hand_scale="fit"),
    )  # fmt: skip


def fitted(missing: float, scale: HandScale = HandScale(), first=None):
    sensor = Sensor((160, 120), missing=missing)
    seen = list(depth_views(MEAN, POSES, sensor, np.random.default_rng(3)))
    run = run_of(scale, seen, first)
    posed = [
        posed_result(
            run.model, one, run.model.transform.solver_params(joint), Judgement(Status.TRACKED)
        )
        for one, joint in zip(seen, POSES, strict=True)
    ]
    return run, size_of_frames(run, posed, 2, None, lambda share, words: None)  # type: ignore[arg-type]


def test_half_a_hand_tells_no_size():
    run, size = fitted(0.5, SMALL)
    assert size is not None
    assert size.overall == 1.0
    held = run.with_scale(size)
    assert size.std["length_mm"] == pytest.approx(POPULATION_SIGMA * hand_length_mm(MEAN))
    assert who_is_open(held) is None
    given = SimpleNamespace(xyz=np.zeros((21, 3)))
    assert fitted(0.5, SMALL, given)[1].overall == SMALL.overall


def test_what_is_stated_of_joints_includes_a_size_that_is_held():
    def stated(scale: HandScale) -> np.ndarray:
        model = load_model("hand26", scale=scale)
        params = model.rest_params()
        seen = next(iter(depth_views(MEAN, POSES, Sensor((160, 120)), np.random.default_rng(0))))
        terms = frame_terms(model, TrackerSettings(), seen, model.bones(params), None)
        none = np.zeros((len(model.joint_names), 3, 3))
        found = judged(terms, params, 1.0, {"cloud": 1.0}, none, ())
        return np.trace(found.joint_covariance, axis1=1, axis2=2)

    held = replace(HandScale(), std={"overall": POPULATION_SIGMA, "length_mm": 12.0})
    more = np.sqrt(stated(held) - stated(HandScale()))
    joints = MEAN.joint_positions(MEAN.bones(MEAN.rest_params()))
    away = np.linalg.norm(joints - joints.mean(axis=0), axis=1)
    np.testing.assert_allclose(more, POPULATION_SIGMA * away, rtol=1e-6, atol=1e-9)


def test_the_first_frames_do_not_decide_where_they_are_bad():
    """In 42 frames a detector is off by a hand's breadth; the 30 after them, each sure, tell who it is."""
    poses, cameras = waving_poses(), [camera_at(k) for k in range(3)]
    filmed, noise = load_model("hand26", scale=HandScale(1.08)), np.random.default_rng(5)
    seen, poses = [], np.concatenate([poses, poses[:12], poses])
    for frame, pose in enumerate(poses):
        points, off = filmed.keypoints21(filmed.bones(pose)), 60.0 if frame < 42 else 1.0
        views = [
            ImageKeypoints(c, keypoint_names(), c.project(points) + off * noise.normal(size=(21, 2)), 1.0)
            for c in cameras
        ]  # fmt: skip
        seen.append(Observation(frame, frame / 30.0, keypoints=tuple(views)))

    def track(frames, start, params, should_stop):
        for frame in frames:
            yield Tracker(MEAN, TrackerSettings()).step_without_search(
                TrackerState.beginning_at(poses[frame]), seen[frame]
            )[1]

    run = run_of(HandScale(), seen)
    run.track, run.initial, run.with_values = track, lambda: (0, poses[0]), lambda values: run
    run.session.frame_range, run.session.frame_count = range(len(seen)), len(seen)
    tracked = tracked_for_size(run, None, None, lambda share, words: None)  # type: ignore[arg-type]
    size = size_of_frames(run, tracked, 8, None, lambda share, words: None)  # type: ignore[arg-type]
    assert size is not None
    assert size.overall == pytest.approx(1.08, abs=0.02)
