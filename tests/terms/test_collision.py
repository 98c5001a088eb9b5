"""Overlap of parts: known answers, agreement with the plain form, and what neighbours may do."""

import numpy as np
import pytest

from handtrack import load_model
from handtrack.geometry.rotation import rotation_matrix
from handtrack.solver.levenberg_marquardt import solve
from handtrack.solver.problem import Problem
from handtrack.terms.collision import CollisionTerm, colliding_pairs, contact
from handtrack.terms.priors import GaussianPrior
from tests.terms.collision_reference import signed_distance
from tests.terms.silhouette_scene import parts_at

PAIR = np.array([[0, 1]])


@pytest.mark.parametrize(("apart", "depth"), [(0.25, 0.0), (0.2, 0.0), (0.17, 0.03), (0.05, 0.15)])
def test_two_balls(apart, depth):
    flesh, bones = parts_at([[0.1] * 3, [0.1] * 3], [[0, 0, 0], [0, apart, 0]])
    term = CollisionTerm(flesh, PAIR, sigma_m=0.02, slack_m=0.01)
    assert term.depths(bones)[0] == pytest.approx(depth, abs=1e-12)
    over = max(depth - 0.01, 0.0) / 0.02
    assert term.cost(bones) == pytest.approx(0.5 * over**2, abs=1e-12)


def test_parts_that_lie_in_each_other_are_parted_sideways():
    """Crossed thighs with one middle: every direction looks alike from the centres, the way out is across both."""
    turns = rotation_matrix(np.array([[0, 0, 0.4], [0, 0, -0.4]]))
    flesh, bones = parts_at([[0.08, 0.25, 0.07]] * 2, [[0, 0, 0], [0, 0, 0]], turns)
    assert CollisionTerm(flesh, PAIR).depths(bones)[0] == pytest.approx(0.14)


def test_it_agrees_with_the_plain_form(rng):
    """Shapes as parts have, touching or deep in each other."""
    seen = 0
    for _ in range(60):
        radii = rng.uniform(0.03, 0.15, (2, 3))
        turns = rotation_matrix(rng.normal(size=(2, 3)))
        centre = rng.normal(size=3)
        centre *= rng.uniform(0.08, 0.25) / np.linalg.norm(centre)
        flesh, bones = parts_at(radii, [[0, 0, 0], centre], turns)
        one, other = (t @ np.diag(r**2) @ t.T for t, r in zip(turns, radii, strict=True))
        expected = max(-signed_distance(centre, one, other), 0.0)
        depth = CollisionTerm(flesh, PAIR).depths(bones)[0]
        assert depth == pytest.approx(expected, abs=1e-7)
        seen += expected > 0
    assert seen > 20


def test_neighbours_and_what_touches_at_rest_do_not_collide():
    body = load_model("body34")
    assert len(colliding_pairs(body, body.ellipsoids["fine"])) > 100
    assert CollisionTerm.of(body).cost(body.bones(body.rest_params())) == 0.0


def test_a_hand_s_fingers_cross_in_front_of_each_other():
    """Asked to lie in each other, index and middle finger part until only their flesh is pressed."""
    hand = load_model()
    names, crossed = hand.parameter_names, hand.rest.copy()
    for finger, spread_deg in (("index", -12), ("middle", 14)):
        crossed[names.index(f"{finger}_mcp_abd")] = np.deg2rad(spread_deg)
        crossed[names.index(f"{finger}_mcp_flex")] = 0.0
    start = hand.clipped(hand.transform.solver_params(crossed))
    wanted = GaussianPrior(hand.joint_params(start), np.full(len(names), 0.1), "wanted")
    term = contact(hand)
    assert term.depths(hand.bones(start)).max() > 0.006
    found = solve(Problem(hand, (term,), (wanted,)), start).params
    assert term.depths(hand.bones(found)).max() < 0.003
