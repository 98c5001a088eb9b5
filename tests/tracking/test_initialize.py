"""First frame from keypoints: pose, hand size."""

import numpy as np
import pytest

from handtrack import HandScale, Keypoints, load_model
from handtrack.model.articulated import keypoint_names
from handtrack.model.pose_library import named_pose
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


def test_the_hands_size_is_found_from_noisy_keypoints():
    truth = HandScale(1.08, {"thumb": 0.97})
    model = load_model(scale=truth)
    errors = []
    for seed in range(6):
        seen = seen_pose(model, "open", np.random.default_rng(seed), noise=0.005)
        scale = fit_scale(lambda s: load_model(scale=s), seen)
        errors.append(scale.overall / truth.overall - 1)
    assert np.sqrt(np.mean(np.square(errors))) < 0.03
