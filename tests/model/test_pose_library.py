"""The pose library: 26 letters and the common poses, all within limits, each its own."""

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose, pose_names
from handtrack.tracking.frame.terms.contact import contact


@pytest.fixture(scope="module")
def hand():
    return load_model("hand26")


def joints(hand, name):
    return hand.joint_positions(hand.bones(hand.transform.solver_params(named_pose(hand, name))))


def at(hand, name, joint):
    return joints(hand, name)[hand.joint_names.index(joint)]


@pytest.mark.parametrize("name", pose_names())
def test_every_pose_is_within_limits(hand, name):
    joint = named_pose(hand, name)
    bounds = hand.limits.bounds(joint)
    outside = (joint < bounds[:, 0] - 1e-9) | (joint > bounds[:, 1] + 1e-9)
    assert not outside.any(), [hand.parameter_names[i] for i in np.flatnonzero(outside)]
    assert not joint[:6].any()  # the root stays at the world's origin


def test_no_finger_lies_inside_another_part():
    """Flesh gives way by about 3 mm where pads press on each other; they had lain up to 14.7 mm deep (S)."""
    hand = load_model()
    for name in pose_names():
        pose = hand.transform.solver_params(named_pose(hand, name))
        depths = contact(hand).depths(hand.bones(pose))
        assert depths.max() < 3.2e-3, name
