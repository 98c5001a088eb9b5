"""Known motions: through their poses, within limits, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.simulation.motion import MOTIONS, motion

MODEL = load_model()


def moved(name, frames=61, seed=0, **more):
    return motion(MODEL, name, frames, np.random.default_rng(seed), **more)


@pytest.mark.parametrize("name", MOTIONS)
def test_it_passes_through_its_poses_within_limits(name):
    joint = moved(name)
    assert joint.shape == (61, 26)
    poses = MOTIONS[name]
    for pose, frame in zip(poses, np.linspace(0, 60, len(poses)), strict=True):
        if frame == int(frame):
            angles = named_pose(MODEL, pose)[6:]
            np.testing.assert_allclose(joint[int(frame), 6:], angles, atol=1e-12)
    for params in joint:
        limits = MODEL.limits.bounds(params)
        assert (params >= limits[:, 0]).all()
        assert (params <= limits[:, 1]).all()


def test_between_two_poses_angles_do_not_overshoot():
    joint = moved("curl")[:, 6:]
    ends = np.stack([named_pose(MODEL, pose)[6:] for pose in MOTIONS["curl"]])
    assert (joint >= ends.min(axis=0) - 1e-12).all()
    assert (joint <= ends.max(axis=0) + 1e-12).all()


def test_the_hand_wanders_smoothly_near_the_origin():
    joint = moved("open_fist_open", 100)
    step = np.diff(joint, axis=0)
    assert 1e3 * np.abs(step[:, :3]).max() < 8.0
    assert 1e3 * np.abs(np.diff(step[:, :3], axis=0)).max() < 1.0
    assert np.rad2deg(np.abs(step[:, 3:6]).max()) < 5.0
    assert np.rad2deg(np.abs(step[:, 6:]).max()) < 6.0
    assert np.linalg.norm(joint[:, :3] + [0, 0.09, 0], axis=1).max() < 0.1


def test_without_wander_the_root_stays():
    joint = moved("open_fist_open", wander=0.0)
    np.testing.assert_array_equal(joint[:, :6], np.tile([0, -0.09, 0, 0, 0, 0], (61, 1)))


def test_the_seed_decides():
    np.testing.assert_array_equal(moved("curl", seed=3), moved("curl", seed=3))
    assert (moved("curl", seed=3) != moved("curl", seed=4)).any()


def test_an_unknown_motion_names_the_known():
    with pytest.raises(HandtrackError) as error:
        moved("wave")
    assert str(error.value).startswith("no motion 'wave'; ")
    assert all(name in str(error.value) for name in MOTIONS)
