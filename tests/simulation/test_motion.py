"""Known motions: through their poses, within limits, the same for the same seed."""

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.simulation.motion import MOTIONS, motion

MODEL = load_model()


def moved(name, frames=61, seed=0, **more):
    return motion(MODEL, name, frames, np.random.default_rng(seed), **more)


@pytest.mark.parametrize("name", MOTIONS["hand"])
def test_it_passes_through_its_poses_within_limits(name):
    joint = moved(name)
    assert joint.shape == (61, 26)
    poses = MOTIONS["hand"][name]
    for pose, frame in zip(poses, np.linspace(0, 60, len(poses)), strict=True):
        if frame == int(frame):
            angles = named_pose(MODEL, pose)[6:]
            np.testing.assert_allclose(joint[int(frame), 6:], angles, atol=1e-12)
    for params in joint:
        limits = MODEL.limits.bounds(params)
        assert (params >= limits[:, 0]).all()
        assert (params <= limits[:, 1]).all()
