"""All fingers one off: which way the hand moves and whose bends a finger takes over, against every way tried by hand."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from handtrack.model.articulated import FINGERS
from handtrack.model.model_file import load_model
from handtrack.tracking.frame.control import Control
from handtrack.tracking.search.engine import Candidate, improved
from handtrack.tracking.search.policy import LOST_FINGER
from handtrack.tracking.search.proposers.finger_moves import finger_shifts

BENDS = ("mcp_flex", "pip_flex", "dip_flex")
TRUE = dict(zip(FINGERS[1:], (0.1, 0.5, 0.9, 1.2), strict=True))


def bent(model, joint, by_finger):
    joint = joint.copy()
    for finger, angle in by_finger.items():
        for bend in BENDS:
            joint[model.skeleton.parameter(f"{finger}_{bend}")] = angle
    return joint


def knuckles(model, joint):
    places = model.joint_positions(model.bones(model.transform.solver_params(joint)))
    return places[[model.joint_names.index(f"{finger}_mcp") for finger in FINGERS[1:]]]


def moved(model, joint, side):
    """Return the hand moved by a knuckle: side 1 puts the index finger where the middle one was."""
    at = knuckles(model, joint)
    joint = joint.copy()
    joint[:3] += side * (at[1] - at[0])
    return joint


def handed(by_finger, side):
    """Return the bends by finger, each taken from its neighbour on the little finger's side (1) or the thumb's (−1)."""
    given = dict(by_finger)
    for one, other in pairwise(FINGERS[1:]):
        to, source = (one, other) if side > 0 else (other, one)
        given[to] = by_finger[source]
    return given


def cost_of(model, truth):
    """Return the cost of a pose: all joints' squared distances to where they are seen, σ = 5 mm."""
    seen = model.joint_positions(model.bones(model.transform.solver_params(truth)))

    def cost(params):
        return 0.5 * float(
            (((model.joint_positions(model.bones(params)) - seen) / 0.005) ** 2).sum()
        )

    return cost


class Shifts:
    """A landscape in which fingers are shifted and nothing descends, so that what is found is one of the starts."""

    def __init__(self, model, cost):
        self.model, self.cost = model, cost

    def propose(self, proposer, found):
        starts = finger_shifts(self.model, found[0].params) if proposer == "finger shift" else []
        return [Candidate(self.model, x, self.cost(x), proposer) for x in starts]

    def fit(self, fit, candidates, control):
        return list(candidates)

    def distinct(self, candidates, most):
        return sorted(candidates, key=lambda c: c.cost)[:most]


def found_from(model, cost, start):
    standing = Candidate(model, start, cost(start))
    return improved(LOST_FINGER, Shifts(model, cost), standing, Control(), 0, "a test").params


@pytest.mark.parametrize("hand", ["right", "left"])
@pytest.mark.parametrize("side", [1, -1])
def test_the_hand_goes_back_and_each_finger_takes_its_neighbours_bends(hand, side):
    """The palm is a knuckle off and each finger is bent as the one whose place it took: undone by the opposite of both."""
    model = load_model(side=hand)
    truth = bent(model, np.zeros(26), TRUE)
    off = bent(model, moved(model, truth, side), handed(TRUE, side))
    cost = cost_of(model, truth)
    ways = {
        (way, bends): cost(bent(model, moved(model, off, way), handed(handed(TRUE, side), bends) if bends else handed(TRUE, side)))
        for way in (1, 0, -1)
        for bends in (1, 0, -1)
    }  # fmt: skip
    assert min(ways, key=ways.__getitem__) == (-side, -side), "the scene is as it is meant"
    least = min(ways.values())
    start = model.transform.solver_params(off)
    found = found_from(model, cost, start)
    assert cost(found) <= least + 1.0
    names = model.parameter_names
    for finger in FINGERS[2:4]:  # those that have neighbours on both sides
        pip = names.index(f"{finger}_pip_flex")
        assert model.joint_params(found)[pip] == pytest.approx(TRUE[finger], abs=1e-6)


@pytest.mark.parametrize("side", [1, -1])
def test_a_palm_alone_that_is_off_goes_back_with_its_bends(side):
    """The fingers are bent as they should be: only the palm is moved."""
    model = load_model()
    truth = bent(model, np.zeros(26), TRUE)
    cost = cost_of(model, truth)
    start = model.transform.solver_params(moved(model, truth, side))
    found = found_from(model, cost, start)
    assert cost(found) < 0.05 * cost(start)
    np.testing.assert_allclose(found[6:], truth[6:], atol=1e-9)


@pytest.mark.parametrize(("better_by", "taken"), [(1.9, False), (2.1, True)])
def test_a_finger_is_taken_only_where_the_pose_is_two_log_likelihoods_better(better_by, taken):
    assert LOST_FINGER.is_better(50.0 - better_by, 50.0) == taken
