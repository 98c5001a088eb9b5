"""Simulated recordings: motion, rendering, textures, sessions."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import Session, load_model
from handtrack.model.ellipsoids import Ellipsoids, model_mask
from handtrack.model.pose_library import named_pose
from handtrack.simulation.motion import MOTIONS, motion
from handtrack.simulation.render import render
from handtrack.simulation.simulate import Simulation, simulate
from tests.cameras import pinhole

SMALL = {"frames": 3, "size": (160, 120), "cameras": 2, "fps": 1.0}


@pytest.mark.parametrize(("side", "lens"), [("right", False), ("left", False), ("right", True)])
def test_a_session_opens_and_its_truth_is_the_motion(tmp_path, side, lens):
    """A distorted camera shows the same hand once undistorted."""
    what = Simulation(
        **SMALL, side=side, scale=1.1, distortion=lens, images=False, init_noise_m=0.0, seed=5
    )
    session = Session.open(simulate(tmp_path / "new", what))
    model = load_model(side=side, scale=1.1)
    joint = motion(model, what.motion, what.frames, np.random.default_rng(5))
    assert session.frame_count == 3
    assert all(camera.is_distorted == lens for camera in session.rig)
    assert session.fps == what.fps
    for frame, params in enumerate(joint):
        bones = model.bones(params)
        assert_allclose(session.truth.keypoints21[frame], model.keypoints21(bones))
        flesh = model.ellipsoids["fine"].posed(bones)
        for seen in session.observation(frame).silhouettes:
            exact = model_mask(seen.camera, flesh).astype(np.uint8)
            if lens:
                rim = cv2.dilate(exact, np.ones((3, 3))) - cv2.erode(exact, np.ones((3, 3)))
                assert np.abs(seen.mask - exact)[rim == 0].max() < 0.01
                assert abs(float(seen.mask.sum()) / exact.sum() - 1) < 0.01
            else:
                assert np.abs(seen.mask - exact).sum() <= 2
    first = model.params_from(dict(session.init.parameters))
    assert_allclose(first, joint[0], atol=1e-12)


MODEL = load_model()


@pytest.mark.parametrize("name", MOTIONS["hand"])
def test_it_passes_through_its_poses_within_limits(name):
    joint = motion(MODEL, name, 61, np.random.default_rng(0))
    assert joint.shape == (61, 26)
    poses = MOTIONS["hand"][name]
    for pose, frame in zip(poses, np.linspace(0, 60, len(poses)), strict=True):
        if frame == int(frame):
            angles = named_pose(MODEL, pose)[6:]
            assert_allclose(joint[int(frame), 6:], angles, atol=1e-12)
    assert_array_equal([MODEL.clipped(params) for params in joint], joint)


FOCAL, SIZE = 200.0, (101, 81)


def test_a_ball_on_the_axis_is_a_disc_of_its_tangent_cone():
    """Radius r at distance d is seen under tan = r/√(d² − r²)."""
    ball = Ellipsoids(np.zeros(1, int), np.eye(3)[2:], np.eye(3)[None], np.full((1, 3), 0.1))
    front, *_ = render(pinhole("cam0", SIZE, FOCAL), ball)
    v, u = np.mgrid[: SIZE[1], : SIZE[0]]
    reach = FOCAL * 0.1 / np.sqrt(1.0 - 0.01)
    disc = (u - 50) ** 2 + (v - 40) ** 2 < reach**2
    assert_array_equal(front >= 0, disc)
