"""Joints to hands: in space, of an unknown size, triangulated from images, or with what one camera leaves open."""

import numpy as np
import pytest

from handtrack import HandScale, Keypoints, load_model
from handtrack.model.articulated import keypoint_names
from handtrack.model.pose_library import named_pose
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.search.keypoint_start import (
    fit_keypoints,
    fit_scale,
    hands_from_images,
    triangulated,
)
from tests.tracking.scenes import joints_seen, posed

MODEL = load_model()
CAMERAS = [camera.without_distortion() for camera in simulated_rig(3, (640, 480)).cameras]


def points_of(params):
    return MODEL.keypoints21(MODEL.bones(params))


def error_mm(params, points):
    return 1e3 * np.linalg.norm(points_of(params) - points, axis=1).mean()


def test_a_wrong_view_of_a_point_is_dropped():
    points = points_of(posed(MODEL, "rest", [0.3, 0.5, -0.2]))
    seen = joints_seen(CAMERAS, points)
    seen[1].pixels[8] += 150.0
    seen[2].pixels[12] = np.nan
    assert triangulated(seen, keypoint_names()) == pytest.approx(points, abs=1e-9)
    assert np.isnan(triangulated(seen[:2], keypoint_names())[8]).all(), (
        "of two that disagree, neither is believed"
    )


@pytest.mark.parametrize("turn", [[0.3, 0.5, -0.2], [0.0, 2.6, 0.4], [-1.3, 0.2, 2.0]])
def test_two_cameras_give_the_hand_and_one_leaves_a_choice_with_it(rng, turn):
    points = points_of(posed(MODEL, "curl", turn))
    seen = joints_seen(CAMERAS[:2], points, rng.normal(size=(2, 21, 2)))
    best = hands_from_images(MODEL, seen)[0]
    assert error_mm(best.params, points) < 3.0
    assert best.confidence > 0.5
    found = hands_from_images(MODEL, seen[:1])
    assert min(error_mm(h.params, points) for h in found) < 15.0
    assert [h.cost for h in found] == sorted(h.cost for h in found)
    assert sum(h.confidence for h in found) == pytest.approx(1.0)
    for h in (h for h in found if h.confidence > 0.01):
        off = CAMERAS[0].project(points_of(h.params)) - seen[0].pixels
        assert np.median(np.linalg.norm(off, axis=1)) < 5.0, "all of them look like what was seen"


def seen_pose(model, pose, rng, noise=0.0):
    joint = named_pose(model, pose)
    joint[:6] = rng.normal(scale=0.5, size=6)
    points = model.keypoints21(model.bones(model.transform.solver_params(joint)))
    return Keypoints(
        keypoint_names(), points + rng.normal(scale=noise, size=points.shape), noise or 1e-3
    )


@pytest.mark.parametrize("pose", ["open", "fist", "point", "pinch"])
def test_exact_keypoints_give_back_the_hand(rng, pose):
    seen = seen_pose(MODEL, pose, rng)
    error = np.linalg.norm(points_of(fit_keypoints(MODEL, seen)) - seen.positions, axis=1)
    assert error.max() < 1e-3  # the weak pull to the relaxed hand is all that is left


def test_the_hands_size_is_found_from_noisy_keypoints():
    truth = HandScale(1.08, {"thumb": 0.97})
    model = load_model(scale=truth)
    errors = []
    for seed in range(6):
        seen = seen_pose(model, "open", np.random.default_rng(seed), noise=0.005)
        scale = fit_scale(lambda s: load_model(scale=s), seen)
        errors.append(scale.overall / truth.overall - 1)
    assert np.sqrt(np.mean(np.square(errors))) < 0.03
