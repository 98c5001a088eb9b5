"""What hypotheses put into a search's rounds: headings, trees of the best minima, draws."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from handtrack import ImageKeypoints, Observation, TrackerSettings, load_model
from handtrack.sampling.chains import chains_of, prepare
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.hypotheses import mixture_search
from handtrack.tracking.hypotheses.mixture_search import (
    Component,
    FirstHypotheses,
    NextHypotheses,
    ReferenceCamera,
    Source,
    Start,
)
from handtrack.tracking.hypotheses.motion_belief import MotionBelief

HAND = load_model()
CAMERA = simulated_rig(1, (320, 240)).cameras[0]
INDEX = [prepare(HAND, chain) for chain in chains_of(HAND) if chain.name == "index"]
SETTINGS = TrackerSettings().with_values({"mixture.draws": 8})


def objective(kind, *more):
    pixels = CAMERA.project(HAND.joint_positions(HAND.bones(HAND.rest_params())))
    seen = ImageKeypoints(CAMERA, HAND.joint_names, pixels, 1.0)
    eye = ReferenceCamera.of(HAND, Observation(0, 0.0, keypoints=(seen,)))
    return kind(HAND, SETTINGS, INDEX, eye, np.random.default_rng(3), *more)


def frame():
    return FrameTerms(HAND, SETTINGS, (), (), None, None, (), ())


def minimum(flex, cost, source):
    params = HAND.rest_params()
    params[HAND.transform.names.index("middle_pip_flex")] = flex
    return Start(HAND, params, cost, normal=1e6 * np.eye(len(params)), source=source)


class Leaf(NamedTuple):
    """A tree of one leaf."""

    params: np.ndarray


def turn(a, b):
    return np.linalg.norm(HAND.bones(a).rotation[0] - HAND.bones(b).rotation[0])


def test_a_first_frame_looks_all_around_and_then_from_the_start_as_well():
    first = objective(FirstHypotheses, frame(), HAND.rest_params())
    around = first.headings_at_low_resolution([], 4)
    assert len(around) == 4
    # half a turn between opposite ones, a quarter between neighbours: Frobenius norm 2 √2 sin(angle / 2)
    for other, angle in ((1, np.pi / 2), (2, np.pi), (3, np.pi / 2)):
        apart = turn(around[0].params, around[other].params)
        assert apart == pytest.approx(2 * np.sqrt(2) * np.sin(angle / 2))
    found = first.start_and_candidates(around[1:], 0)
    np.testing.assert_array_equal(found[0].params, HAND.rest_params())
    assert [c.params[3] for c in found[1:]] == [c.params[3] for c in around[1:]]
    assert found[0].source.sought is first.terms


def test_trees_grow_from_the_best_of_the_latest_round():
    """An earlier round's minimum costs least of all, but its own tree was looked at before."""
    first = objective(FirstHypotheses, frame(), HAND.rest_params())
    before, latest = Source("start", frame(), frame(), 4), Source("first tree", frame(), frame(), 4)
    flexed = ((0.3, 0.0, before), (1.6, 3.0, latest), (0.9, 1.0, latest), (0.2, 2.0, latest))
    starts = first.interpretation_trees_of_the_best([minimum(*row) for row in flexed], 2)
    column = HAND.transform.names.index("middle_pip_flex")
    rows = np.array([c.params for c in starts])
    assert rows[0, column] == 0.9
    # trees flip the index alone, samples around a minimum that is known well stay near it
    assert set(np.round(rows[:, column], 1)) == {0.9, 0.2}
    at = HAND.joint_names.index("index_tip")
    tips = np.array([HAND.joint_positions(HAND.bones(row))[at] for row in rows])
    assert np.ptp(tips, axis=0).max() > 0.02, "the index bends another way"
    samples = SETTINGS.mixture.draws // 2
    assert len(rows) > 2 * (1 + samples), "leaves beside minima and samples"


def test_draws_go_to_all_hypotheses_in_turn_and_by_weight(monkeypatch):
    """Of eight draws four are taken in turn, so that a light hypothesis jumps too; nearly all others are the heavy one's."""
    monkeypatch.setattr(mixture_search, "interpretation_tree", lambda model, x, *_: Leaf(x[None]))
    belief = MotionBelief.at_rest(HAND.rest_params(), 1e-4 * np.eye(26), np.ones(26))
    heavy, light = Component(belief, frame(), 1.0 - 1e-9), Component(belief, frame(), 1e-9)
    following = objective(NextHypotheses, [heavy, light])
    jumped = following.each_jumped_along_chains([], 0)
    counts = [sum(c.source.parent == i for c in jumped) for i in range(2)]
    assert counts == [6, 2]
    followed = following.each_followed([], 0)
    for i in range(2):
        own = [c for c in followed if c.source.parent == i]
        np.testing.assert_array_equal(own[0].params, belief.mean)
        assert len(own) == 1 + counts[i], "the expected pose, and flips that may be near enough"
    assert {c.origin for c in followed} == {"followed"}
    assert {c.origin for c in jumped} == {"index jumped"}


def test_a_chain_jumps_as_probably_as_it_is_voted_for(monkeypatch):
    """The prior of its jumps is in proportion to its vote; without chains nothing jumps."""
    monkeypatch.setattr(mixture_search, "interpretation_tree", lambda model, x, *_: Leaf(x[None]))
    belief = MotionBelief.at_rest(HAND.rest_params(), 1e-4 * np.eye(26), np.ones(26))
    two = [prepare(HAND, chain) for chain in chains_of(HAND) if chain.name in ("index", "ring")]

    def log_priors(votes):
        monkeypatch.setattr(mixture_search, "chain_votes", lambda *_: np.array(votes))
        following = objective(NextHypotheses, [Component(belief, frame(), 1.0)])
        jumped = replace(following, chains=two).each_jumped_along_chains([], 0)
        return {c.origin: c.source.log_prior for c in jumped}

    even, uneven = log_priors([0.5, 0.5]), log_priors([0.2, 0.8])
    assert uneven["index jumped"] - even["index jumped"] == pytest.approx(np.log(0.4))
    assert uneven["ring jumped"] - even["ring jumped"] == pytest.approx(np.log(1.6))
    stiff = replace(objective(NextHypotheses, [Component(belief, frame(), 1.0)]), chains=())
    assert not stiff.each_jumped_along_chains([], 0)
