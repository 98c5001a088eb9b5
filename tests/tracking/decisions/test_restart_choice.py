"""Which pose a doubtful frame gets: the best that was found, and only where it fits clearly better than what stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.result import Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.evidence.start_shapes import shape_of
from handtrack.tracking.search.laid_shapes import Laid
from handtrack.tracking.search.restart import recovered, worth_restarting
from handtrack.tracking.search.start_search import narrowly_measured, start_sources
from handtrack.tracking.tracker import Tracker

MODEL = load_model()
PLAIN = TrackerSettings().with_values({"tracker.jumps": False, "tracker.escape": False})
TRUTH = MODEL.rest_params()
TRUTH[1] = -0.09
SEEN = mask_views(MODEL, TRUTH, simulated_rig(2, (160, 120)).cameras, 1)


def aside(metres):
    params = TRUTH.copy()
    params[0] += metres
    return params


def cost_of(params):
    sources = start_sources(SEEN, PLAIN)
    laid = Laid(shape_of(MODEL, MODEL.joint_params(params), "test"), params, np.inf)
    return narrowly_measured(sources, laid).cost


@pytest.fixture(scope="module")
def known():
    return replace(Tracker(MODEL, PLAIN).step(replace(SEEN, frame=0), (), TRUTH), frame=0)


@pytest.fixture(scope="module")
def standing(known):
    """A doubtful frame 15 mm aside."""
    there = MODEL.joint_params(aside(0.015))
    return replace(known, frame=1, status=Status.DOUBTFUL, parameters=there)


def costing(share):
    """Return a pose (P,) that costs this share of what the standing one costs, found by halving."""
    wanted, low, high = share * cost_of(aside(0.015)), 0.0, 0.015
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if cost_of(aside(middle)) < wanted else (low, middle)
    assert cost_of(aside(low)) == pytest.approx(wanted, rel=0.01)
    return aside(low)


def chosen(standing, known, *poses):
    """Return what is taken where solving from the starts that are found ends at these poses in turn."""
    ends = [replace(standing, parameters=MODEL.joint_params(pose)) for pose in poses]
    count = iter(range(1000))
    return recovered(MODEL, PLAIN, SEEN, standing, [known], lambda _: ends[next(count) % len(ends)])


@pytest.mark.parametrize(("share", "taken"), [(0.7, True), (0.93, True), (0.97, False)])
def test_another_pose_is_taken_at_95_percent_of_the_cost(standing, known, share, taken):
    pose = costing(share)
    found = chosen(standing, known, pose)
    assert (found is not standing) == taken
    if taken:
        np.testing.assert_allclose(found.parameters[0], pose[0])


def test_of_several_the_cheapest_is_taken(standing, known):
    for order in ((0.8, 0.5, 0.6), (0.5, 0.8, 0.6), (0.8, 0.6, 0.5)):
        poses = [costing(share) for share in order]
        found = chosen(standing, known, *poses)
        assert found.parameters[0] == pytest.approx(costing(0.5)[0])


def test_a_poor_cloud_and_a_hand_without_fingers_are_left_alone(standing, known):
    poor = replace(standing, poor_cloud=True)
    assert chosen(poor, known, TRUTH) is poor
    glove = load_model("glove9")
    assert recovered(glove, PLAIN, SEEN, standing, [known], lambda _: known) is standing


def tried(results, first):
    """Return which of these frames, after a first one, are looked at again."""
    rows, previous = [], [first]
    for row, result in enumerate(results, 1):
        if worth_restarting(result, previous):
            rows.append(row)
        previous.append(result)
    return rows


def test_a_row_of_doubts_is_tried_ever_more_rarely(standing, known):
    unseen = replace(standing, energy=float("nan"), status=Status.LOST)
    assert tried([standing] * 33, known) == [1, 2, 4, 8, 16, 32]
    assert tried([known] * 5, known) == []
    # a frame that fits begins the row anew; one that only leaves something open fits
    assert tried([standing] * 3 + [known] + [standing] * 3, known) == [1, 2, 5, 6]
    opened = replace(standing, unknown=True)
    assert tried([standing] * 3 + [opened] + [standing] * 3, known) == [1, 2, 5, 6]
    # frames in which nothing was seen end no row and do not count in it, but are looked at every fifth time
    assert tried([standing, unseen, standing], known) == [1, 2]
    assert tried([unseen] * 12, known) == [1, 2, 4, 5, 8, 10]
    assert tried([*[unseen] * 6, standing], known)[-1] == 7
