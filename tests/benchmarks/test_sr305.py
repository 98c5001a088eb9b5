"""Real depth frames of a hand: found without a first pose, the hand's size fitted, cloud and model close."""

import numpy as np

from handtrack.capture.clouds.depth import depth_cloud
from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.simulation.render import pixel_rays, render
from tests.experiments.scenes.depth_hand import AROUND_TIP_M, CAMERA, UNIT_M, hand_points


def test_hand_points_are_told_from_depth_alone():
    """A rendered hand with its forearm: five fingertips, the hand's points, hardly any of the arm's."""
    model = load_model(forearm=True)
    joint = named_pose(model, "open")
    joint[2], joint[4] = 0.55, np.pi  # palm to the camera
    bones = model.bones(model.transform.solver_params(joint))
    flesh = model.flesh["fine"].posed(bones)
    front, depth, _ = render(CAMERA, flesh, pixel_rays(CAMERA))
    steps = np.round(np.where(front >= 0, depth, 0.0) / UNIT_M) * UNIT_M
    found = hand_points(depth_cloud(CAMERA, steps).points)
    tips = model.keypoints21(bones)[4::4]
    apart = np.linalg.norm(found.tips[:, None] - tips, axis=2)
    assert apart.shape == (5, 5)
    assert apart.min(axis=0).max() < 0.02
    arm = flesh.bone[np.maximum(front, 0)] == model.skeleton.bone("forearm")
    hand = (front >= 0) & ~arm
    assert 0.8 * hand.sum() < len(found.points) < 1.1 * hand.sum()  # the wrist covers the arm's end
    assert (
        np.linalg.norm(found.points[:, None] - found.tips, axis=2).min(axis=1).max() <= AROUND_TIP_M
    )
