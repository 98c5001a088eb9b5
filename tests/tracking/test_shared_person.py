"""The person whom all frames share: size and detector's offsets found with the poses, cameras and time."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import (
    HandScale,
    Observation,
    PointCloud,
    Silhouette,
    TrackerSettings,
    load_model,
)
from handtrack.model.articulated import ShapeCovariance, keypoint_names
from handtrack.model.ellipsoids import model_mask
from handtrack.model.model_file import read_scale, write_scale
from handtrack.model.pose_changes import moved
from handtrack.model.size import SizeParameters, hand_length_mm
from handtrack.solver.problem import Problem
from handtrack.terms.clouds import visible_from
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.priors import GaussianPrior
from handtrack.tracking.size.cameras import CameraChanges
from handtrack.tracking.size.estimate import Shared, estimate_whole, fit_size
from handtrack.tracking.size.person import PersonChange, Subject, shape_covariance
from handtrack.tracking.whole.chosen_frames import fit_person
from handtrack.tracking.whole.likelihood import Recording, RecordingLikelihood
from handtrack.tracking.whole.refinement import Refinement
from tests.derivatives import check_gradient
from tests.tracking.scenes import joints_seen, on_surface
from tests.tracking.test_shared_cameras import (
    FPS,
    camera_at,
    mean_off_mm,
    points_of,
    refined,
    watched,
    waving_poses,
)

HAND = load_model("hand26")
WHO = Subject(lambda scale: load_model("hand26", scale=scale))
OTHER = HandScale(1.06, {"thumb": 0.95, "index": 1.05})
POSES = waving_poses(20)


CAMERAS = [camera_at(k) for k in range(3)]
TRUTH = points_of(POSES, WHO.build(OTHER))


def test_a_frames_system_has_the_derivatives_of_its_cost_by_pose_cameras_and_person(rng):
    poses = POSES[:3]
    observe = watched(CAMERAS, [TRUTH[:3]] * 3)
    recording = Recording(HAND, TrackerSettings(), observe)
    likelihood = RecordingLikelihood(recording, dict(enumerate(poses)), 1 / FPS)
    looks = [(observe(0), HAND.bones(poses[0]).position.mean(axis=0))] * 4
    person = PersonChange.of(HAND, looks, replace(WHO, offsets=True))
    assert person.free.all()
    assert set(HAND.proportions.names) < set(person.parameters.names)
    shared = Shared(CameraChanges.of([observe(0)]), person)
    larger = np.where(np.arange(shared.count) < shared.cameras.count, 0.1, 0.5)
    shared = shared.stepped(larger * rng.normal(size=shared.count))
    speed, size = 0.1 * rng.normal(size=poses.shape), poses.shape[1]

    def system(x):
        there = shared.stepped(x[size:])
        pose = moved(poses, np.tile(x[:size], (3, 1)))
        views = there.cameras.views(pose, speed)
        seen = likelihood.sharing(there).of(1)
        return seen.linearize(pose[1], views, 1, there.person)[0]

    zero = np.zeros(size + shared.count)
    check_gradient(lambda x: system(x).cost, system(zero).gradient, zero, rtol=1e-6)


def test_a_size_that_was_wrong_and_a_camera_that_is_late_are_found_with_the_poses(rng):
    """The late one measures clouds, too."""
    hand, late = WHO.build(OTHER), waving_poses(20, -1.6)
    clouds = [PointCloud(on_surface(hand, pose, 300, rng)[0]) for pose in late]
    points = [TRUTH, points_of(late, hand), TRUTH]
    seen = watched(CAMERAS, points, cloud_cameras=["cam1"])
    _, frames, found = refined(lambda n, _=0: replace(seen(n), cloud=clouds[n]), POSES, subject=WHO)
    assert mean_off_mm(frames, TRUTH) < 1.0
    assert "cam1" in found.words[0]
    told = {one.name: one.late_frames for one in found.cameras}
    assert told == pytest.approx({"cam0": 0.0, "cam1": 1.6, "cam2": 0.0}, abs=0.1)
    model = WHO.build(found.scale)
    assert found.scale.overall == pytest.approx(1.06, abs=0.01)
    assert found.scale.parts["thumb"] == pytest.approx(0.95, abs=0.02)
    # the frames are this person's
    pose = model.transform.solver_params(frames[3].parameters)
    assert_allclose(model.keypoints21(model.bones(pose)), frames[3].keypoints21)


def test_a_pose_set_by_hand_tells_of_the_person():
    """Of wrist, knuckles and tips alone nobody knows whether a finger is short or bent."""
    poses, points = POSES[::2], TRUTH[::2].copy()
    points[:, [n.endswith(("_pip", "_dip")) for n in keypoint_names()]] = np.nan

    def off(**held):
        found = refined(watched(CAMERAS, [points] * 3), poses, subject=WHO, **held)[2]
        lengths = [WHO.build(scale).skeleton.length for scale in (found.scale, OTHER)]
        return np.abs(np.subtract(*lengths)).sum()

    assert off(keyframes={5: poses[5]}) < 0.95 * off()  # measured 0.81


def test_one_camera_tells_no_size():
    place, seen = HAND.bones(POSES[0]).position.mean(axis=0), watched(CAMERAS, [TRUTH] * 3)(0)
    one = replace(seen, keypoints=seen.keypoints[:1])
    assert PersonChange.of(HAND, [(one, place)], WHO).count == 0
    assert PersonChange.of(HAND, [(seen, place)], WHO).free.all()


def test_what_was_found_of_a_person_comes_back_as_it_was_written():
    errors = ShapeCovariance.of(("overall", "thumb"), np.array([[2.0, 1.0], [1.0, 3.0]]))
    found = Refinement(
        "converged", 3, (), replace(OTHER, std={"length_mm": 0.5}, covariance=errors)
    )
    again = Refinement.read(found.text)
    assert again.scale == OTHER
    assert again.scale.std == {"length_mm": 0.5}
    assert again.scale.covariance == errors
    assert Refinement.read('{"why": "converged", "sweeps": 3, "cameras": []}').scale is None


def test_information_of_recordings_adds(rng, tmp_path):
    """Two recordings, linear in the shape: the second begins with the file of the first."""
    size = SizeParameters(HAND)
    count = len(size.names)
    true, known, model = rng.normal(size=count), None, HAND
    together, right = np.eye(count), np.zeros(count)
    stated = []
    for number in range(2):
        rows = rng.normal(size=(20, count))  # fewer than numbers: the rest is known beforehand
        told = rows @ true + 0.1 * rng.normal(size=20)
        together, right = together + 100.0 * rows.T @ rows, right + 100.0 * rows.T @ told
        own = SizeParameters(model)
        person = PersonChange(own, np.ones(count, bool), own.deviations(model.scale), known)
        prior = person.prior()
        hessian = prior.hessian + 100.0 * rows.T @ rows
        gradient = prior.gradient + 100.0 * rows.T @ (rows @ person.values - told)
        found = person.stepped(-np.linalg.solve(hessian, gradient)).scale(np.linalg.inv(hessian))
        write_scale(tmp_path / f"{number}.toml", found)
        known = read_scale(tmp_path / f"{number}.toml")
        model = load_model(scale=known)
        stated.append(shape_covariance(size, known))
    assert_allclose(size.deviations(known), np.linalg.solve(together, right), rtol=1e-6, atol=1e-7)
    assert_allclose(stated[1], np.linalg.inv(together), rtol=1e-5, atol=1e-9)
    assert np.linalg.eigvalsh(stated[0] - stated[1]).min() > -1e-9


def test_what_is_not_free_is_known_better_by_what_errs_with_it():
    """Where a file says that two numbers err together, as only their sum was seen, one that is found tells the other's uncertainty."""
    size = SizeParameters(HAND)
    both = np.array([[1.0, -0.9], [-0.9, 1.0]]) * np.outer(size.units[:2], size.units[:2])
    known = HandScale(covariance=ShapeCovariance.of(size.names[:2], both))
    free = np.array([name == "overall" for name in size.names])
    person = PersonChange(size, free, size.deviations(HAND.scale), known)
    found = person.scale(np.array([[0.01]]))
    assert found.std["overall"] == pytest.approx(0.1 * size.units[0])
    assert found.std["thumb"] == pytest.approx(size.units[1] * np.sqrt(1 - 0.81 * 0.99))
    assert found.std["index"] == pytest.approx(size.units[2])


def test_a_file_with_fewer_numbers_or_others_is_read():
    size = SizeParameters(HAND)
    old = HandScale(
        1.02,
        std={"overall": 0.02, "nose": 3.0},
        covariance=ShapeCovariance.of(("overall", "nose"), np.diag([4e-4, 9.0])),
    )
    stated = shape_covariance(size, old)
    assert stated[0, 0] == pytest.approx((0.02 / size.units[0]) ** 2)
    assert_array_equal(stated[1:, 1:], np.eye(len(stated) - 1))


def test_a_cloud_tells_what_it_shows_of_a_hands_shape(rng):
    """How thick a palm is, before depth cameras at either side; before one the prior is left."""
    hand, told = load_model("hand26", "left"), {"palm_thickness": 2.0, "palm_breadth": 1.0}
    subject = Subject(lambda scale: load_model("hand26", "left", scale))
    person = subject.build(HandScale(proportions=told))
    poses = POSES[::3]
    near = [poses[0, :3] + np.array([[0.05, 0.1, z]]) for z in (0.5, -0.5)]

    def found(views):
        seen = []
        for frame, pose in enumerate(poses):
            points, normals = on_surface(person, pose, 4000, rng)
            points = points[visible_from(points, normals, views)]
            cloud = PointCloud(points + rng.normal(scale=1e-3, size=points.shape))
            seen.append(Observation(frame, 3 * frame / FPS, cloud=cloud, cloud_views=tuple(views)))
        looks = [(one, poses[0, :3]) for one in seen]
        recording = Recording(hand, TrackerSettings(), lambda frame, _: seen[frame])
        around, changes = dict(enumerate(poses)), PersonChange.of(hand, looks, subject)
        likelihood = RecordingLikelihood(recording, around, 3 / FPS, person=changes)
        estimate = estimate_whole(likelihood, range(len(poses)), poses)
        assert estimate.scale is not None
        return estimate.scale

    around, front = found(near), found(near[:1])
    for name, value in told.items():
        assert abs(around.proportions[name] - value) < 2.0 * around.std[name]
        assert around.std[name] < front.std[name]
    assert around.proportions["palm_thickness"] > 1.0
    for name in ("palm_thickness", "finger_depth", "thumb_flesh_depth"):
        assert abs(front.proportions[name]) < 0.5
        assert front.std[name] > 0.8


def test_masks_of_one_camera_that_are_too_wide_make_no_thicker_hand():
    """A segmentation that takes a rim of background for hand does so in all frames."""
    poses = POSES[::10]
    flesh = HAND.ellipsoids["fine"]
    seen = []
    for frame, pose in enumerate(poses):
        views = [
            Silhouette(c, model_mask(c, flesh.thicker(wide).posed(HAND.bones(pose))) + 0.0)
            for c, wide in zip(CAMERAS, (0.0, 0.003, 0.0), strict=True)
        ]
        seen.append(Observation(frame, frame / 3.0, tuple(views)))
    found = fit_person(replace(WHO, offsets=True), HAND, TrackerSettings(), seen, poses)
    assert found is not None
    model = WHO.build(found)
    assert hand_length_mm(model) == pytest.approx(hand_length_mm(HAND), rel=0.01)
    thicker = np.log(model.ellipsoids["fine"].radii / flesh.radii)
    assert abs(thicker.mean()) < 0.02


@pytest.mark.parametrize("lasts", [False, True], ids=["new in each frame", "the same in all"])
def test_the_stated_doubt_of_a_length_is_the_true_one(lasts):
    """With a detector's errors of its sigma, new in each of six frames, and with one error in all of them, which counts once."""
    off, filmed, poses = [], WHO.build(HandScale(1.06)), POSES[:18:3]
    prior = GaussianPrior(HAND.rest, np.r_[np.full(6, np.inf), np.full(20, 0.7)])
    for seed in range(6):
        noise = np.random.default_rng(seed).normal(scale=4.0, size=(6, 3, 21, 2))
        problems = []
        for errors, points in zip(noise, points_of(poses, filmed), strict=True):
            seen = joints_seen(CAMERAS, points, noise[0] if lasts else errors, 4.0)
            problems.append(Problem(HAND, [KeypointTerm(HAND, each) for each in seen], [prior]))
        scale, _ = fit_size(problems, list(poses), repeated=6.0 if lasts else 1.0)
        missed = hand_length_mm(WHO.build(scale)) - hand_length_mm(filmed)
        off.append(missed / scale.std["length_mm"])
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.5
