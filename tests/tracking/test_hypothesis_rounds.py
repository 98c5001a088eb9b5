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
    NextHypotheses,
    ReferenceCamera,
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


class Leaf(NamedTuple):
    """A tree of one leaf."""

    params: np.ndarray


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
