"""All fingers one off: the escape repairs it and never makes a pose dearer."""

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from tests.experiments.clouds.finger_shift import AS_GOOD, one_finger_off, repair


@pytest.mark.parametrize("side", ["right", "left"])
def test_each_finger_starts_where_its_neighbour_is(side):
    model = load_model(side=side)
    pose = named_pose(model, "lsf_v")  # index and middle straight, the others bent
    off = one_finger_off(model, pose, 1.0)
    true, moved = (model.joint_positions(model.bones(x)) for x in (pose, off))
    for finger, other in (("index", "middle"), ("middle", "ring"), ("ring", "little")):
        at, there = (model.joint_names.index(f"{f}_mcp") for f in (finger, other))
        assert np.linalg.norm(moved[at] - true[there]) < 0.01  # neighbours are 20 mm apart
        at, there = (model.skeleton.parameter(f"{f}_pip_flex") for f in (finger, other))
        assert off[at] == pytest.approx(pose[there])
    assert off[model.skeleton.parameter("middle_pip_flex")] > 1.0  # bent, where it was straight


@pytest.mark.parametrize(("seen", "seeds"), [("cloud", (3, 8)), ("silhouettes", (3, 6))])
def test_what_descent_leaves_wrong_is_repaired(seen, seeds):
    """Two of those that descent alone leaves wrong; 50 seeds are in docs/explanation/accuracy.md. Of the first 14 in masks contact lost one (8)."""
    rows = [repair(seed, seen) for seed in seeds]
    for row in rows:
        assert row.alone_cost > row.truth_cost + AS_GOOD
        assert row.escaped_cost <= row.alone_cost
        assert row.escaped_cost <= row.truth_cost + AS_GOOD


def test_a_worse_view_never_makes_it_dearer():
    row = repair(2, "depth")
    assert row.escaped_cost <= row.alone_cost
