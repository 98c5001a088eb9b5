"""The one engine of command line and workbench: what a session makes of settings, first pose, forearm and size."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import (
    HandScale,
    ImageKeypoints,
    Observation,
    Session,
    Tracker,
    TrackerSettings,
    TrackerState,
    TrackingRun,
    load_model,
)
from handtrack.model.articulated import keypoint_names
from handtrack.model.size import FOREARM_END, POPULATION_SIGMA, hand_length_mm
from handtrack.session.run import (
    ineffective_settings,
    person_to_fit,
    size_of_frames,
    tracked_for_size,
)
from handtrack.session.session_file import CameraSettings, HandSettings
from handtrack.simulation.motion import motion
from handtrack.simulation.simulate import Simulation, simulate, simulated_rig
from handtrack.tracking.frame.confidence import frame_confidence
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_task import posed_result
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import model_of
from tests.app.command_line import QUICK
from tests.experiments.scenes.simulated_clouds import Sensor, depth_views
from tests.session.small_session import joints_session
from tests.tracking.test_shared_cameras import camera_at, waving_poses


@pytest.fixture(scope="module")
def run(session):
    return TrackingRun.open(session)


def test_a_result_says_where_it_comes_from(session, run):
    track = run.result(reversed(list(run.track(range(2), *run.initial()))))
    assert_array_equal(track.frame, [0, 1])
    assert (track.model, track.side, track.session) == ("hand26", "right", session.name)
    assert json.loads(track.scale) == {"overall": 1.0, "parts": {}}
    settings = json.loads(track.settings)
    assert settings == json.loads(json.dumps(run.settings.flat()))
    assert settings["silhouettes.term"] == "coverage"
    assert track.version
    assert_allclose(track.time_s, [0.0, 1 / session.fps])


def misleading(folder, arm):
    """Write four frames before three small cameras; masks of the first are wrong about whether there is an arm."""
    what, made = Simulation(size=(160, 120), images=False), []
    for one in (not arm, arm):
        model = load_model(forearm=one)
        joint = motion(model, "open_fist_open", 40, np.random.default_rng(0))[:4]
        known = model, joint, 0.0
        made.append(simulate(folder / str(one), what, known=known))
    for mask in (made[0] / "masks").glob("*/*0000.*"):
        (made[1] / mask.relative_to(made[0])).write_bytes(mask.read_bytes())
    with (made[1] / "session.toml").open("a") as file:
        file.write(QUICK)
    return made[1]


@pytest.mark.parametrize("arm", [False, True])
def test_all_frames_say_whether_there_is_an_arm(tmp_path, arm):
    """Frames tracked without the arm that is there, or with one that is not, say so."""
    folder = misleading(tmp_path, arm)
    run = TrackingRun.open(Session.open(folder), {"tracker.estimate": "forward"})
    assert run.forearm is not arm
    found = list(run.track(range(4), *run.initial()))
    right = run.with_arm_of(found)
    assert right.forearm is arm
    seen = list(right.track(range(4), *right.initial()))
    assert right.with_arm_of(seen) is right
    if arm:
        cuffed = right.with_forearm(0.03)
        assert cuffed.with_arm_of(seen).arm_m == right.arm_m
        ends = cuffed.with_scale(replace(cuffed.scale, proportions={FOREARM_END: 1.0}))
        assert ends.with_arm_of(seen) is ends, "its end was found with the shape"
    asked = run.with_values({"model.forearm": str(not arm).lower()})
    assert asked.with_arm_of(found) is asked


def test_a_cuff_is_modelled_as_long_as_masks_show_it_and_found_again(run):
    """In another size it grows with the hand; a result is built again with it; a forearm asked for is a whole one."""
    cuffed = run.with_forearm(0.04)
    length = {}
    for one in (cuffed, cuffed.with_scale(HandScale(1.1)), cuffed.with_values({"tracker.seed": 1})):
        length[one.scale.overall] = one.model.skeleton.length[one.model.skeleton.bone("forearm")]
    assert length == pytest.approx({1.0: 0.04, 1.1: 0.044})
    again = model_of(cuffed.result(cuffed.track(range(1), *cuffed.initial())))
    assert_allclose(again.ellipsoids["fine"].radii, cuffed.model.ellipsoids["fine"].radii)
    arm = run.with_forearm(np.inf).model
    asked = cuffed.with_values({"model.forearm": "true"}).model
    assert_array_equal(asked.ellipsoids["fine"].radii, arm.ellipsoids["fine"].radii)


MEAN = load_model("hand26")
SMALL = HandScale(0.67)
POSES = motion(MEAN, "open_fist_open", 100, np.random.default_rng(0))[:2]


def run_of(scale, observations, first=None):
    """Return what of a run a fit of the size asks for."""

    def with_scale(size):
        return run_of(size, observations, first)

    return SimpleNamespace(
        model=load_model("hand26", scale=scale), settings=TrackerSettings(), scale=scale, first=first, with_scale=with_scale,
        observation_of=lambda result: observations[result.frame], sees_joints=False, offsets_are_open=False, prior_person=None, size_is_open=True, asks_for_size=True,
        session=SimpleNamespace(hand_scale="fit"),
    )  # fmt: skip


def fitted(missing, scale=HandScale(), first=None):
    sensor = Sensor((160, 120), missing=missing)
    seen = list(depth_views(MEAN, POSES, sensor, np.random.default_rng(3)))
    run = run_of(scale, seen, first)
    poses = map(run.model.solver_params, POSES)
    posed = [posed_result(run.model, *both) for both in zip(seen, poses, strict=True)]
    return run, size_of_frames(run, posed, 2)  # type: ignore[arg-type]


def test_half_a_hand_tells_no_size():
    run, size = fitted(0.5, SMALL)
    assert size.overall == 1.0
    held = run.with_scale(size)
    assert size.std["length_mm"] == pytest.approx(POPULATION_SIGMA * hand_length_mm(MEAN))
    assert person_to_fit(held) is None
    given = SimpleNamespace(xyz=np.zeros((21, 3)))
    assert fitted(0.5, SMALL, given)[1].overall == SMALL.overall


def test_what_is_stated_of_joints_includes_a_size_that_is_held():
    def stated(scale):
        model = load_model("hand26", scale=scale)
        params = model.rest_params()
        seen = next(depth_views(MEAN, POSES, Sensor((160, 120)), np.random.default_rng(0)))
        terms = frame_terms(model, TrackerSettings(), seen, model.bones(params), None)
        none = np.zeros((len(model.joint_names), 3, 3))
        posed = posed_result(model, seen, params)
        posed = replace(posed, energies={"cloud": 1.0}, joint_covariance=none)
        found = frame_confidence(posed, terms, params, 1.0, ())
        return np.trace(found.joint_covariance, axis1=1, axis2=2)

    held = replace(HandScale(), std={"overall": POPULATION_SIGMA, "length_mm": 12.0})
    more = np.sqrt(stated(held) - stated(HandScale()))
    joints = MEAN.joint_positions(MEAN.bones(MEAN.rest_params()))
    away = np.linalg.norm(joints - joints.mean(axis=0), axis=1)
    assert_allclose(more, POPULATION_SIGMA * away, rtol=1e-6, atol=1e-9)


def test_the_first_frames_do_not_decide_where_they_are_bad():
    """In 42 frames a detector is four sigmas off a smaller hand; the 30 after them, each sure, tell who it is."""
    poses, cameras = waving_poses(), [camera_at(k) for k in range(3)]
    noise = np.random.default_rng(5)
    seen, poses = [], np.concatenate([poses, poses[:12], poses])
    for frame, pose in enumerate(poses):
        size, off = (0.85, 4.0) if frame < 42 else (1.08, 1.0)
        filmed = load_model("hand26", scale=HandScale(size))
        points = filmed.keypoints21(filmed.bones(pose))
        views = tuple(
            ImageKeypoints(c, keypoint_names(), c.project(points) + off * noise.normal(size=(21, 2)), 1.0)
            for c in cameras
        )  # fmt: skip
        seen.append(Observation(frame, frame / 30.0, keypoints=views))

    def track(frames, start, params, control):
        for frame in frames:
            yield Tracker(MEAN, TrackerSettings()).step_without_search(
                TrackerState.beginning_at(poses[frame]), seen[frame]
            )[1]

    run = run_of(HandScale(), seen)
    run.track, run.initial, run.with_values = track, lambda: (0, poses[0]), lambda values: run
    run.session.frame_range = range(len(seen))
    tracked = tracked_for_size(run, None, Control())  # type: ignore[arg-type]
    size = size_of_frames(run, tracked, 8)  # type: ignore[arg-type]
    assert size.overall == pytest.approx(1.08, abs=0.02)
    still = [replace(tracked[-1], frame=frame) for frame in range(60, 68)]
    assert size_of_frames(run, still, 8)  # type: ignore[arg-type]


def recording(masks="masks/*.png", images=None, clouds=False):
    """Return what a session has to track by."""
    camera = SimpleNamespace(settings=CameraSettings("cam0", images=images, masks=masks))
    return SimpleNamespace(views=(camera,), has_clouds=clouds)


@pytest.mark.parametrize(
    "values, seen, idle",
    [
        ({"cloud.weight": 0, "silhouettes.outline_sigma_mm": 2}, {}, []),
        ({"cloud.balance": 0.2}, {"clouds": True}, []),
        ({"cloud.balance": 0.2, "cloud.sigma_mm": 3}, {}, ["cloud.balance and cloud.sigma_mm"]),
        ({"cloud.balance": 0.2, "cloud.weight": 0}, {"clouds": True}, ["cloud.balance"]),
        ({"silhouettes.term": "conic_field"}, {"masks": None}, ["silhouettes.term"]),
        ({"edges.sigma_px": 3, "edges.weight": 1}, {}, ["edges.sigma_px"]),
        ({"mixture.draws": 9}, {}, ["mixture.draws"]),
        ({"model.spread_ring": 0.5}, {}, ["model.spread_ring"]),
    ],
)
def test_only_what_is_idle_is_named(values, seen, idle):
    said = ineffective_settings(TrackerSettings().with_values(values), recording(**seen), "hand")
    assert [text.partition(" ha")[0] for text in said] == idle


def test_what_is_too_simple_does_not_tell_a_size(tmp_path):
    session = Session.open(
        joints_session(tmp_path, simulated_rig(2, (320, 240)), HandSettings(scale="fit"))
    )
    ball = TrackingRun.open(session, {"model.name": "ball6"})
    assert not ball.size_is_open and "ball6" in ball.notes[-1]
