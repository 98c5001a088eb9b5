"""First frames without a first pose, from silhouettes, clouds and both, whatever way the hand is turned; and which side it is."""

import numpy as np
import pytest

from handtrack import (
    HandScale,
    Observation,
    PointCloud,
    Status,
    TrackerSettings,
    load_model,
)
from handtrack.model.pose_library import named_pose
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.search.global_search import auto_start, other_side_log_odds
from tests.tracking.scenes import off_mm, on_surface, posed

HANDS = [load_model(forearm=arm) for arm in (False, True)]
FILMED = load_model(scale=HandScale(1.05))  # another person's
EYE = np.array([0.0, 0.0, -0.5])


def turned(pose, rng, model=FILMED):
    """Return params (P,) of a pose with any turn, the palm within 5 cm of the world's origin."""
    joint = named_pose(model, pose)
    joint[3:6] = rng.normal(size=3)
    joint[3:6] *= rng.uniform(0.0, np.pi) / np.linalg.norm(joint[3:6])
    params = model.transform.solver_params(joint)
    middle = model.joint_positions(model.bones(params)).mean(axis=0)
    params[:3] += rng.uniform(-0.05, 0.05, size=3) - middle
    return params


def test_silhouettes_of_a_hand_turned_anyhow(rng):
    params = turned("rest", rng)
    seen = mask_views(FILMED, params, simulated_rig(2, (160, 120)).cameras)
    found = auto_start(HANDS, TrackerSettings(), seen)
    assert off_mm(found[0].result, FILMED, params).mean() < 12.0
    assert not found[0].model.has_forearm, "there is none to be seen"
    assert found[0].confidence > 0.7
    assert sum(c.confidence for c in found) <= 1.0 + 1e-9
    costs = [c.cost for c in found]
    assert costs == sorted(costs)
    others = [off_mm(c.result, FILMED, params).mean() for c in found[1:]]
    assert all(error > 12.0 for error in others), "each pose is told once"


def test_a_forearm_is_noticed_in_a_depth_cameras_cloud(rng):
    arm = load_model(forearm=True)
    params = turned("open", rng, arm)
    points, _ = on_surface(arm, params, 4000, rng, EYE)
    cloud = PointCloud(points + rng.normal(scale=0.001, size=points.shape))
    found = auto_start(
        HANDS, TrackerSettings(), Observation(0, 0.0, cloud=cloud, cloud_views=(EYE[None],))
    )
    assert found[0].model.has_forearm
    assert found[0].result.status == Status.TRACKED
    assert off_mm(found[0].result, arm, params).mean() < 12.0


@pytest.mark.parametrize("wrong", [False, True])
def test_c31_the_side_is_told_by_silhouettes(wrong):
    """A wrong hand's palm looks where the true one's back does: there the outlines are alike."""
    hands = [load_model("hand26", side) for side in ("right", "left")]
    pose = posed(hands[0], "open")
    seen = mask_views(hands[0], pose, simulated_rig(3, (160, 120)).cameras)
    if wrong:
        pose[4] = np.pi
        hands.reverse()
    odds = other_side_log_odds(*hands, TrackerSettings(), [(seen, pose)])
    assert odds > 3 if wrong else odds < -3
