"""Cameras that are turned, zoomed or late among others: found with the poses, told, and put right; those known to be late are predicted at their own time."""

from dataclasses import replace
from functools import cache
from itertools import product

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import (
    ImageKeypoints,
    Observation,
    PointCloud,
    Silhouette,
    Tracker,
    TrackerSettings,
    load_model,
)
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.articulated import keypoint_names
from handtrack.model.ellipsoids import model_mask
from handtrack.model.metaballs import MetaballSurface
from handtrack.terms.clouds import CloudDistanceTerm, prepare_cloud
from handtrack.terms.own_time import AtOwnTime, BoneMotion
from handtrack.tracking.frame.control import Control
from handtrack.tracking.sequence import track_frames
from handtrack.tracking.size.cameras import LATE, NUMBERS, TIME, ZOOMED, CameraChanges
from handtrack.tracking.size.estimate import Shared, WholeEstimate
from handtrack.tracking.size.person import PersonChange, Subject
from handtrack.tracking.whole.chosen_frames import fit_person
from handtrack.tracking.whole.likelihood import Recording
from handtrack.tracking.whole.recording_estimate import refine, refine_near
from handtrack.tracking.whole.refinement import CameraError, Refinement
from tests.cameras import pinhole
from tests.derivatives import check_gradient, check_observation_term
from tests.tracking.scenes import QUICK, Told, bent, on_surface

HAND = load_model("hand26")
BENT = np.array(["_mcp_flex" in n or "_pip_flex" in n for n in HAND.parameter_names])
FPS, SIGMA_PX = 30.0, 1.0
AROUND = np.deg2rad([-50.0, 0.0, 45.0])


def camera_at(k, turn=0.0, zoom=1.0):
    """Return one of three cameras around the hand, at 0.5 m, turned about the vertical too far [rad] and zoomed."""
    away, seen = (rotation_matrix(np.array([0.3, AROUND[k] + by, 0.0])) for by in (turn, 0.0))
    place = away @ seen.T @ np.array([0.0, -0.08, 0.5])
    return pinhole(f"cam{k}", (640, 480), 500.0 * zoom, away, place, at=(320, 240))


def waving_poses(frames=30, later=0.0):
    """Return poses (F, P) of a hand that waves and closes, so many frames later."""
    way = 2.0 * np.pi / (frames - 1) * (np.arange(frames) + later)
    poses = np.tile(HAND.rest_params(), (frames, 1))
    poses[:, 0] += 0.06 * np.sin(way)
    poses[:, 2] += 0.03 * np.sin(2.0 * way)
    poses[:, 4] += 0.4 * np.sin(way + 1.0)
    poses[:, BENT] = np.deg2rad(40.0) - np.deg2rad(25.0) * np.cos(way)[:, None]
    return np.array([HAND.clipped(pose) for pose in poses])


def watched(cameras, points, **more):
    """Return what is seen in each frame by the three cameras, which the program takes for these; points: those that each has before it (F, 21, 3)."""
    pixels = np.array([camera_at(k).project(own) for k, own in enumerate(points)])
    pixels += SIGMA_PX * np.random.default_rng(5).normal(size=pixels.shape)

    def observe(frame, _bones=None):
        views = [
            ImageKeypoints(camera, keypoint_names(), seen[frame], SIGMA_PX)
            for camera, seen in zip(cameras, pixels, strict=True)
        ]
        return Observation(frame, frame / FPS, keypoints=tuple(views), **more)

    return observe


def refined(observe, poses, **more):
    """Return the live frames, those refined, and what is said that all share."""
    tracker, told = Tracker(HAND, TrackerSettings().with_values(QUICK)), Told()
    live = list(track_frames(tracker, observe, 0, poses[0], range(len(poses))))
    frames = refine(
        Recording(HAND, tracker.settings, observe, Control(observer=told), **more), live
    )
    return live, frames, Refinement.read(told[0])


def points_of(poses, hand=HAND):
    return np.array([hand.keypoints21(hand.bones(pose)) for pose in poses])


def mean_off_mm(frames, truth):
    return 1e3 * np.linalg.norm(np.array([r.keypoints21 for r in frames]) - truth, axis=2).mean()


POSES = waving_poses()
TRUTH = points_of(POSES)


# measured 1.94 of 4.0 mm, and 0.7 of 17: as much is no detector's bias, and said
@pytest.mark.parametrize(("deg", "most_mm"), [(0.6, 2.6), (2.0, 1.0)])
def test_a_camera_that_was_turned_is_put_right(deg, most_mm):
    cameras = [camera_at(0, np.deg2rad(deg)), camera_at(1), camera_at(2, zoom=1.004)]
    _, frames, found = refined(watched(cameras, [TRUTH] * 3), POSES)
    assert mean_off_mm(frames, TRUTH) < most_mm
    assert [bool(one.words) for one in found.cameras] == [deg > 1.0, False, False]


def test_frames_beside_a_correction_are_seen_by_cameras_as_all_frames_found_them():
    late = points_of(waving_poses(later=-1.6))
    observe = watched([camera_at(k) for k in range(3)], [TRUTH, late, TRUTH])
    live = track_frames(Tracker(HAND), observe, 0, POSES[0], range(30))
    straight = [HAND.joint_params(bent(HAND, pose, "index", 0.0)) for pose in POSES]
    wrong = [replace(r, parameters=p) for r, p in zip(live, straight, strict=True)]

    def cost(*cameras):
        recording = Recording(
            HAND, TrackerSettings(), observe, keyframes={15: POSES[15]}, cameras=cameras
        )
        return np.mean([r.energy for r in refine_near(recording, wrong, [15])])

    found = CameraError("cam1", (0.0,) * 3, (0.0,) * 3, 0.0, 1.6, (0.01,) * 9)
    assert cost(found) < 0.8 * cost()  # measured 0.64: what joints cost that are let go is bounded


def test_clean_cameras_are_left_alone_and_predicted_at_the_time_of_each_of_their_frames():
    """Two have rates of their own: 24 and 21 images in the time of 30 frames."""
    frames, rates = np.arange(30), (1.0, 0.8, 0.7)
    later = [np.round(rate * frames) / rate - frames for rate in rates]
    points = [points_of(waving_poses(later=by)) for by in later]
    seen = watched([camera_at(k) for k in range(3)], points)

    def observe(frame, _bones=None):
        return replace(seen(frame), frames_later={f"cam{k}": later[k][frame] for k in (1, 2)})

    _, whole, found = refined(observe, POSES)
    # measured 0.59, in step 0.5; 2.2 with one time for all frames
    assert mean_off_mm(whole, TRUTH) < 0.7
    assert all(np.linalg.norm(one.detector_bias_deg) < 0.1 for one in found.cameras)
    assert all(abs(one.late_frames) < 0.05 for one in found.cameras)
    assert found.why == "converged"
    assert found.scale is None


def test_joints_seen_to_one_side_of_a_reaching_hand_are_not_taken_for_a_time_offset():
    poses = np.repeat(POSES[:1], 24, axis=0)
    poses[:, 0] += 0.15 * (1.0 - np.cos(np.linspace(0.0, np.pi, 24)))
    points = points_of(poses)
    beside = points + np.array([0.01, 0.0, 0.0])
    found = refined(watched([camera_at(k) for k in range(3)], [points, points, beside]), poses)[2]
    # measured 0.24, standard deviation 0.21; 0.61 where cameras may not seem to be turned
    assert abs(found.cameras[2].late_frames) < min(0.35, 2.0 * found.cameras[2].std[LATE])


def test_a_camera_that_takes_one_finger_for_another_is_let_go():
    poses = waving_poses(8)
    truth = points_of(poses)
    mistaken = truth.copy()
    mistaken[:, 1:5] = truth[:, 5:9]
    observe = watched([camera_at(k) for k in range(3)], [truth, mistaken, truth])
    _, frames, _ = refined(observe, poses)
    off = np.array([frame.keypoints21 for frame in frames])[:, 1:5] - truth[:, 1:5]
    assert 1e3 * np.linalg.norm(off, axis=2).mean() < 1.5  # measured 1.0; 1.9 where it pulls on
    subject, seen = Subject(lambda scale: load_model(scale=scale)), [observe(n) for n in range(8)]
    found = subject.build(fit_person(subject, HAND, TrackerSettings(), seen, list(poses)))
    longer = (found.skeleton.length - HAND.skeleton.length)[np.array(HAND.groups) == "thumb"]
    assert abs(1e3 * longer.sum()) < 1.0  # measured 0.3 shorter; 2.2 where it pulls on


def test_masks_wider_than_the_hand_are_told_as_wide_as_they_are():
    @cache
    def observe(frame):
        flesh = HAND.ellipsoids["fine"].posed(HAND.bones(POSES[frame]))
        masks = (model_mask(camera_at(k), flesh).astype(np.uint8) for k in range(3))
        wide = (cv2.dilate(mask, disc) for mask in masks)  # 3 px, which are 3 mm
        seen = (Silhouette(camera_at(k), mask.astype(float)) for k, mask in enumerate(wide))
        return Observation(frame, frame / FPS, silhouettes=tuple(seen))

    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))
    _, _, found = refined(lambda frame, _=0: observe(frame), POSES[:6])
    assert [one.wider_mm for one in found.cameras] == pytest.approx([3.0] * 3, abs=0.5)


def _changed(rng):
    cameras = (camera_at(0), camera_at(2))
    scale = np.array([0.1] * 3 + [0.02] * 3 + [0.05, 0.4, 0.002] + [0.05] * 3)
    return CameraChanges(cameras, scale * rng.normal(size=(2, NUMBERS)), (0, 2))


def test_what_is_known_of_cameras_has_its_slope(rng):
    cameras = _changed(rng)
    cameras.values[:, ZOOMED] = 0.0  # held so hard that nothing else would count
    check_gradient(
        lambda step: cameras.stepped(step).prior().cost, cameras.prior().gradient, np.zeros(24)
    )


def test_the_recordings_time_is_that_of_the_cameras_in_step():
    values = np.outer([0.05, 0.0, 0.3, 0.5], TIME)
    assert CameraChanges((camera_at(0),) * 4, values, (0,) * 4).common == 0.05


def test_a_camera_is_corrected_from_what_is_told_of_it(rng):
    """`refinement` of poses.npz is in degrees, millimetres and percent, of the camera; the changes are the hand's."""
    changes = _changed(rng)
    found = WholeEstimate(
        np.zeros((1, 26)), np.zeros((1, 26, 26)), np.zeros(1), 1, "converged",
        Shared(changes, PersonChange.none(HAND)), np.eye(changes.count),
    )  # fmt: skip
    told = Refinement.read(Refinement.of(found).text)
    by_joints = changes.corrected(by_joints=True)
    for camera, corrected, detector, error in zip(
        changes.cameras, changes.corrected(), by_joints, told.cameras, strict=True
    ):
        again = told.corrected(camera)
        assert_allclose(
            error.corrected(camera, by_joints=True).rotation, detector.rotation, atol=1e-5
        )
        assert_allclose(again.matrix, corrected.matrix, atol=1e-4)
        assert_allclose(again.rotation, corrected.rotation, atol=1e-5)
        assert_allclose(again.centre, corrected.centre, atol=1e-6)
    other = camera_at(1)
    assert told.corrected(other) is other


def test_an_error_found_after_a_correction_adds_to_it():
    camera, std = camera_at(0), (0.01,) * 9
    first = CameraError("cam0", (1.0, -2.0, 0.5), (3.0, 0.0, -1.0), 0.8, 0.5, std)
    second = CameraError("cam0", (0.3, 0.4, -1.5), (-1.0, 2.0, 0.5), -0.3, -0.2, std)
    once, twice = second.after(first).corrected(camera), second.corrected(first.corrected(camera))
    assert_allclose(once.matrix, twice.matrix, rtol=1e-5)
    assert_allclose(once.rotation, twice.rotation, atol=1e-5)
    assert_allclose(once.centre, twice.centre, atol=1e-6)
    assert second.after(first).late_frames == pytest.approx(0.3)


def test_a_corrected_camera_sees_the_hand_as_the_changes_say(rng):
    cameras = _changed(rng)
    cameras.values[:, LATE] = 0.0
    pose = HAND.rest_params()[None]

    def both(k, by_joints):
        """Return where a camera sees the changed hand, and its corrected one the hand as it is (B, 2)."""
        views = cameras.views(pose, np.zeros_like(pose))
        changed, hand = HAND.bones(views[k + 2 * by_joints].poses[0]), HAND.bones(pose[0])
        corrected = cameras.corrected(by_joints)[k]
        return cameras.cameras[k].project(changed.position), corrected.project(hand.position)

    for k, by_joints in product(range(2), (False, True)):
        # a zoom is true to its share of the hand's own depth: 5 % of 0.1 m at 0.5 m, a hundredth of the picture
        seen, expected = both(k, by_joints)
        off, size = seen - expected, np.ptp(expected, axis=0).max()
        assert np.abs(off - off.mean(axis=0)).max() < 0.01 * size
        zoom, cameras.values[k, ZOOMED] = cameras.values[k, ZOOMED], 0.0
        assert_allclose(*both(k, by_joints), atol=1e-9)
        cameras.values[k, ZOOMED] = zoom


FRAMES = 11


def poses_at(frames):
    """Return poses (F, P) of a hand that moves by 10 mm and closes by 6° a frame."""
    poses = np.tile(HAND.rest_params(), (len(frames), 1))
    poses[:, 0] += 0.010 * frames
    poses[:, 4] += np.deg2rad(2.0) * frames
    poses[:, BENT] += np.deg2rad(6.0) * frames[:, None]
    return np.array([HAND.clipped(pose) for pose in poses])


def live_error_mm(later, known):
    """Return the error of the last frames of the live pass of three cameras [mm]; later: by how many frames each one's images are."""
    cameras, frames = [camera_at(k) for k in range(3)], np.arange(float(FRAMES))
    points = [points_of(poses_at(frames + by)) for by in later]
    times = {camera.name: by for camera, by in zip(cameras, later, strict=True) if known and by}
    observe, poses = watched(cameras, points, frames_later=times), poses_at(frames)
    live = list(track_frames(Tracker(HAND), observe, 0, poses[0], range(FRAMES)))
    return mean_off_mm(live[5:], points_of(poses[5:]))


def test_a_camera_that_is_known_to_be_late_is_predicted_at_its_own_time():
    later = (0.0, 0.4, -0.4)
    in_step, told = live_error_mm((0.0, 0.0, 0.0), False), live_error_mm(later, True)
    untold = live_error_mm(later, False)
    assert told < 1.25 * in_step
    assert told < 0.6 * untold  # measured 1.20 mm as in step, of 2.3 and 4.3


def cloud_errors_mm(rng, later, told):
    """Return the errors of the last frames by clouds that were taken `later`, live and refined [mm]."""
    frames = np.arange(8.0)
    clouds = [PointCloud(on_surface(HAND, pose, 700, rng)[0]) for pose in poses_at(frames + later)]

    def observe(frame, _bones=None):
        more = {"cloud_cameras": ["cam0"], "frames_later": {"cam0": told * later}}
        return Observation(frame, frame / FPS, cloud=clouds[frame], **more)

    settings, start = TrackerSettings().with_values(QUICK), poses_at(frames[:1])[0]
    found = list(track_frames(Tracker(HAND, settings), observe, 0, start, range(len(frames))))
    both = found, refine(Recording(HAND, settings, observe), found)
    truth = points_of(poses_at(frames))[4:-1]
    return np.array([mean_off_mm(one[4:-1], truth) for one in both])


def test_a_cloud_that_is_known_to_be_late_is_predicted_at_its_own_time(rng):
    told, untold = (cloud_errors_mm(rng, -0.5, told) for told in (True, False))
    assert (told < 0.4 * untold).all()  # measured 1.7 of 5.6 mm live, 0.9 of 5.6 refined


def test_a_term_at_another_time_has_its_derivatives(rng):
    poses = poses_at(np.array([2.0, 2.5]))
    here, there = map(HAND.bones, poses)
    points = on_surface(HAND, poses[1], 200, rng)[0] + rng.normal(scale=0.003, size=(200, 3))
    seen = CloudDistanceTerm(prepare_cloud(points), MetaballSurface.of(HAND), sigma_m=0.003)
    term = AtOwnTime(seen, BoneMotion.between(here, there))
    check_observation_term(term, here, HAND.skeleton.bone_names)
