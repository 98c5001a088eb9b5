"""First frame from keypoints: pose, hand size."""

from __future__ import annotations

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.model.articulated import HandScale, keypoint_names
from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.observation.observation import Keypoints
from handtrack.tracking.search.initialize import fit_keypoints, fit_scale


def seen_pose(model, pose, rng, noise=0.0):
    joint = named_pose(model, pose)
    joint[:6] = rng.normal(scale=0.5, size=6)
    points = model.keypoints21(model.bones(model.transform.solver_params(joint)))
    return Keypoints(
        keypoint_names(), points + rng.normal(scale=noise, size=points.shape), noise or 1e-3
    )


@pytest.mark.parametrize("pose", ["open", "fist", "point", "pinch"])
def test_exact_keypoints_give_back_the_hand(rng, pose):
    model = load_model()
    seen = seen_pose(model, pose, rng)
    params = fit_keypoints(model, seen)
    error = np.linalg.norm(model.keypoints21(model.bones(params)) - seen.positions, axis=1)
    assert error.max() < 1e-3  # the weak pull to the relaxed hand is all that is left


def test_missing_keypoints_are_filled_by_the_model(rng):
    model = load_model()
    seen = seen_pose(model, "curl", rng)
    full = seen.positions.copy()
    seen.positions[[3, 8, 11, 20]] = np.nan
    params = fit_keypoints(model, seen)
    assert np.linalg.norm(model.keypoints21(model.bones(params)) - full, axis=1).max() < 0.03


def test_too_few_keypoints_are_refused():
    points = np.full((21, 3), np.nan)
    points[:3] = np.eye(3)
    with pytest.raises(HandtrackError, match="3 keypoints are known, at least 4 are needed"):
        fit_keypoints(load_model(), Keypoints(keypoint_names(), points, 0.005))


def test_the_hands_size_is_found_from_noisy_keypoints():
    truth = HandScale(1.08, {"thumb": 0.97})
    model = load_model(scale=truth)
    errors = []
    for seed in range(6):
        seen = seen_pose(model, "open", np.random.default_rng(seed), noise=0.005)
        scale = fit_scale(lambda s: load_model(scale=s), seen)
        errors.append(scale.overall / truth.overall - 1)
    assert np.sqrt(np.mean(np.square(errors))) < 0.03
