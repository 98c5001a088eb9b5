"""A left hand tracked as a right one, and the other way round: told where silhouettes decide (fault C31)."""

import numpy as np
import pytest

from handtrack import TrackerSettings, load_model
from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.model.pose_library import named_pose
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.search.other_side import evidence_of_other_side


@pytest.mark.parametrize("wrong", [False, True])
def test_c31_the_side_is_told_by_silhouettes(wrong):
    """A wrong hand's palm looks where the true one's back does: there the outlines are alike."""
    hands = [load_model("hand26", side) for side in ("right", "left")]
    joint = named_pose(hands[0], "open")
    joint[1] -= 0.09
    seen = mask_views(
        hands[0], hands[0].transform.solver_params(joint), simulated_rig(3, (160, 120)).cameras
    )
    if wrong:
        turn = rotation_matrix(joint[3:6]) @ rotation_matrix(np.array([0.0, np.pi, 0.0]))
        joint[3:6] = rotation_vector(turn)
        hands.reverse()
    looks = [(seen, hands[0].transform.solver_params(joint))]
    odds = evidence_of_other_side(*hands, TrackerSettings(), looks)
    assert odds > 3 if wrong else odds < -3
