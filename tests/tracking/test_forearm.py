"""Forearms of all lengths: noticed, and never in the way of the hand."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack import (
    HandScale,
    Observation,
    PointCloud,
    Tracker,
    TrackerSettings,
    TrackerState,
    load_model,
)
from handtrack.model.pose_library import named_pose
from handtrack.model.size import FOREARM_END
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.descent import descend
from handtrack.tracking.frame.frame_task import posed_result
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.terms.forearm import forearm_in_view, forearm_length
from handtrack.tracking.search.frame_solve import with_fingers_recovered
from handtrack.tracking.search.keypoint_start import carried_over
from handtrack.tracking.size.person import Subject
from handtrack.tracking.whole.likelihood import Recording
from handtrack.tracking.whole.recording_estimate import refine
from handtrack.tracking.whole.refinement import Refinement
from tests.tracking.scenes import QUICK, Told, on_surface

HAND, WHOLE = load_model(), load_model(forearm=True)
UNSEARCHED = TrackerSettings().with_values(QUICK)


def near_pair():
    """Two cameras 7 cm apart, 60 cm before the back of the hand."""
    camera = simulated_rig(1, (400, 300), 0.6).cameras[0]
    x = camera.rotation[0]
    return [
        replace(camera, name=f"cam{i}", translation=camera.translation - camera.rotation @ (s * x))
        for i, s in enumerate((-0.035, 0.035))
    ]


def posed(flex=0.0, abd=0.0, x=0.0, pose="open"):
    """The whole hand's joint parameters, its palm near the origin."""
    joint = named_pose(WHOLE, pose)
    joint[0], joint[1] = x, -0.07
    for name, value in (("wrist_flex", flex), ("wrist_abd", abd)):
        joint[WHOLE.skeleton.parameter(name)] = value
    return joint


def without_arm(joint):
    return carried_over(WHOLE, WHOLE.transform.solver_params(joint), HAND)


@pytest.mark.parametrize("length", [0.0, 0.07, 0.2])
def test_the_length_of_a_forearm_is_told_by_two_near_cameras(length):
    """From one side, an arm towards the cameras would be hidden by every hand: that is no sign of one."""
    joint = posed(flex=0.3, abd=0.1)
    filmed = load_model(forearm=length)
    seen = mask_views(
        filmed, carried_over(WHOLE, WHOLE.transform.solver_params(joint), filmed), near_pair()
    )
    found = forearm_length(HAND, HAND.bones(without_arm(joint)), seen.silhouettes)
    assert found == pytest.approx(min(length, 0.1), abs=0.012)
    assert (forearm_in_view(HAND, [(without_arm(joint), seen)]) > 0) is (length > 0)


def test_a_cloud_shows_an_arm_where_it_goes_on_behind_the_wrist(rng):
    hand, whole = without_arm(posed()), WHOLE.transform.solver_params(posed())
    of_hand, _ = on_surface(HAND, hand, 1500, rng)
    bones = WHOLE.bones(whole)
    turned, share = rng.uniform(0, 2 * np.pi, 500), rng.uniform(size=500)
    clouds = [(of_hand, False)]
    for length, shown in ((0.012, False), (0.1, True)):  # the wrist's own end is no arm
        arm = np.stack([0.03 * np.cos(turned), -length * share, 0.018 * np.sin(turned)], axis=1)
        clouds.append((np.concatenate([of_hand, bones.to_world(0, arm)]), shown))
    for points, shown in clouds:
        seen = Observation(0, 0.0, cloud=PointCloud(points))
        assert (forearm_in_view(HAND, [(hand, seen)]) > 0) is shown


def test_an_arm_in_a_cloud_does_not_pull_a_hand_alone():
    """A depth camera shows the arm in too few frames to model one; the hand is as it would be without, not slid back over it."""
    rng, hand = np.random.default_rng(1), without_arm(posed())

    def before_camera(model, params, count):
        points, normals = on_surface(model, params, count, rng)
        points = points[normals[:, 2] > 0.3]
        return points + rng.normal(scale=0.003, size=points.shape)

    alone = before_camera(HAND, hand, 6000)
    arm = before_camera(WHOLE, WHOLE.transform.solver_params(posed()), 9000)
    arm = arm[arm[:, 1] < hand[1] - 0.02]
    start = hand - np.eye(26)[1] * 0.006
    found = []
    for points in (alone, np.concatenate([alone, arm])):
        cloud = PointCloud(points)
        seen = Observation(0, 0.0, cloud=cloud, cloud_views=(np.array([[0.0, 0.0, 0.6]]),))
        _, result = Tracker(HAND, UNSEARCHED).step(TrackerState.beginning_at(start), seen)
        found.append(result.joint_positions)
    moved = np.linalg.norm(found[1] - found[0], axis=1).mean()
    assert moved < 5e-4  # measured 0.1 mm; 1.2 where points behind the wrist counted


@pytest.mark.parametrize("forearm", [False, 0.025])
def test_where_the_arm_ends_is_found_with_all_frames_of_a_known_person_too(forearm):
    """Masks end 10 mm further from the wrist than the model does: the hand slid back after them."""
    truth = load_model(scale=HandScale(proportions={FOREARM_END: 1.3}), forearm=forearm)
    model, told = load_model(forearm=forearm), Told()
    joints = [
        posed(0.0, 0.0, 0.004 * f, pose) for f, pose in enumerate(["open", "curl", "fist"] * 2)
    ]
    joints = [carried_over(WHOLE, WHOLE.transform.solver_params(j), truth) for j in joints]
    cameras = simulated_rig(3, (320, 240)).cameras
    seen = [mask_views(truth, pose, cameras, f) for f, pose in enumerate(joints)]
    live = [posed_result(model, one, pose) for one, pose in zip(seen, joints, strict=True)]
    who = Subject(lambda scale: load_model(scale=scale, forearm=forearm), sizes=False)
    found = refine(
        Recording(model, UNSEARCHED, lambda f, _: seen[f], Control(observer=told), subject=who),
        live,
    )
    scale = Refinement.read(told[0]).scale
    assert scale.proportions[FOREARM_END] == pytest.approx(1.3, abs=0.25)
    assert scale.overall == 1.0
    for pose, result in zip(joints, found, strict=True):
        off = result.keypoints21[0] - truth.keypoints21(truth.bones(pose))[0]
        assert 1e3 * np.linalg.norm(off) < 2.0


@pytest.mark.parametrize(
    ("true", "began"), [((-0.2, -0.3), (1.5, 0.5)), ((1.2, 0.3), (-1.3, -0.6))]
)
def test_a_forearm_that_points_elsewhere_is_found(true, began):
    """A hand that stands right vouches for its fingers, not for the arm: descent leaves that bent to the other side."""
    truth, start = (WHOLE.transform.solver_params(posed(*wrist)) for wrist in (true, began))
    seen = mask_views(WHOLE, truth, simulated_rig(3, (320, 240)).cameras)
    terms = frame_terms(WHOLE, UNSEARCHED, seen, WHOLE.bones(start), None)
    stuck = descend(terms, start)[0].params
    found = with_fingers_recovered(terms, stuck, Control(), 0, "a test")
    wrist = [WHOLE.transform.names.index(name) for name in ("wrist_flex", "wrist_abd")]
    assert np.abs(stuck - truth)[wrist].max() > 0.5
    np.testing.assert_allclose(found[wrist], truth[wrist], atol=0.02)
