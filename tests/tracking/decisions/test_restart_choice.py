"""Which pose a doubtful frame gets: the best that was found, and only where it fits clearly better than what stands."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from handtrack import Status, Tracker, TrackerSettings, TrackerState, load_model
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.frame_result import Solved
from handtrack.tracking.frame.frame_task import FrameTask
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.search import lost_hand
from handtrack.tracking.search.engine import Candidate, Fit, Propose, Round
from handtrack.tracking.search.evidence.hand_shapes import shape_of
from handtrack.tracking.search.global_search import LOST_HAND, GlobalObjective, tracker
from handtrack.tracking.search.lost_hand import with_hand_found
from handtrack.tracking.search.policy import why_hand_may_be_lost

MODEL = load_model()
PLAIN = TrackerSettings().with_values({"tracker.recovery": False, "tracker.escape": False})
TRUTH = MODEL.rest_params()
TRUTH[1] = -0.09
SEEN = mask_views(MODEL, TRUTH, simulated_rig(2, (160, 120)).cameras, 1)


def aside(metres):
    params = TRUTH.copy()
    params[0] += metres
    return params


@cache
def objective():
    return GlobalObjective.of(SEEN, PLAIN)


@cache
def standing_cost():
    return cost_of(aside(0.015))


def cost_of(params):
    shape = shape_of(MODEL, MODEL.joint_params(params), "test")
    return objective().measured(Candidate(MODEL, params, shape=shape)).cost


@pytest.fixture(scope="module")
def known():
    begun = TrackerState.beginning_at(TRUTH)
    return Tracker(MODEL, PLAIN).step(begun, replace(SEEN, frame=0))[1]


@pytest.fixture(scope="module")
def standing(known):
    """A doubtful frame 15 mm aside."""
    there = MODEL.joint_params(aside(0.015))
    return replace(known, frame=1, status=Status.DOUBTFUL, parameters=there)


@cache
def costing(share):
    """Return a pose (P,) that costs this share of what the standing one costs, found by halving."""
    wanted, low, high = share * standing_cost(), 0.0, 0.015
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if cost_of(aside(middle)) < wanted else (low, middle)
    assert cost_of(aside(low)) == pytest.approx(wanted, rel=0.01)
    return aside(low)


@pytest.fixture
def chosen(standing, known, monkeypatch):
    """Return what is taken where the search finds starts here and there, and solving from them ends at given poses in turn."""
    shape = shape_of(MODEL, MODEL.joint_params(TRUTH), "test")
    starts = [Candidate(MODEL, aside(0.03 * n), float(n), "a test", shape) for n in range(1, 6)]
    rounds = (Round((Propose(lambda *_: starts),), keep=0, enter=3, fits=(Fit(tracker),)),)
    monkeypatch.setattr(lost_hand, "LOST_HAND", replace(LOST_HAND, rounds=rounds))

    def choose(*poses, result=standing, model=MODEL):
        ends = iter([replace(result, parameters=MODEL.joint_params(pose)) for pose in poses])
        monkeypatch.setattr(lost_hand, "solve_frame", lambda _: Solved(next(ends)))
        start = MODEL.transform.solver_params(result.parameters)
        task = FrameTask(model, PLAIN, SEEN, start, (known,))
        return with_hand_found(task, Solved(result)).result

    return choose


@pytest.mark.parametrize(("share", "taken"), [(0.7, True), (0.93, True), (0.97, False)])
def test_another_pose_is_taken_at_95_percent_of_the_cost(standing, chosen, share, taken):
    pose = costing(share)
    found = chosen(pose, pose, pose)
    assert (found is not standing) == taken
    if taken:
        np.testing.assert_allclose(found.parameters[0], pose[0])


@pytest.mark.parametrize("order", [(0.8, 0.5, 0.6), (0.5, 0.8, 0.6), (0.8, 0.6, 0.5)])
def test_of_three_that_are_solved_the_cheapest_is_taken(chosen, order):
    poses = {share: costing(share) for share in order}
    found = chosen(*(poses[share] for share in order))
    assert found.parameters[0] == pytest.approx(poses[0.5][0])


def test_a_poor_cloud_and_a_hand_without_fingers_are_left_alone(standing, chosen):
    poor = replace(standing, reason=Reason("poor cloud", number=0.5, other=0.5))
    assert chosen(TRUTH, result=poor) is poor
    assert chosen(TRUTH, model=load_model("glove9")) is standing


def tried(results, first):
    """Return which of these frames, after a first one, are looked at again."""
    rows, previous = [], [first]
    for row, result in enumerate(results, 1):
        if why_hand_may_be_lost(result, previous):
            rows.append(row)
        previous.append(result)
    return rows


def test_a_row_of_doubts_is_tried_ever_more_rarely(standing, known):
    unseen = replace(standing, energy=float("nan"), status=Status.LOST)
    assert tried([standing] * 33, known) == [1, 2, 4, 8, 16, 32]
    assert tried([known] * 5, known) == []
    # a frame that fits begins the row anew; one that only leaves something open fits
    assert tried([standing] * 3 + [known] + [standing] * 3, known) == [1, 2, 5, 6]
    opened = replace(standing, reason=Reason("open", part="hand", number=20.0))
    assert tried([standing] * 3 + [opened] + [standing] * 3, known) == [1, 2, 5, 6]
    # a frame in which nothing was seen ends the row of those with a picture; a row of its own is looked at every fifth time
    assert tried([standing, standing, standing, unseen, standing], known) == [1, 2, 4, 5]
    assert tried([unseen] * 12, known) == [1, 2, 4, 5, 8, 10]
    assert tried([*[unseen] * 6, standing], known)[-1] == 7
