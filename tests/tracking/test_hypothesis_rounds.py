"""What hypotheses put into a search's rounds: headings, trees of the best minima, draws; and when a round is made again."""

from types import SimpleNamespace

import numpy as np
import pytest

from handtrack import ImageKeypoints, Observation, TrackerSettings, load_model
from handtrack.sampling.chains import chains_of, prepare
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.hypotheses.mixture_search import (
    ReferenceCamera,
)
from handtrack.tracking.search.engine import Propose, Round, Search, run_rounds

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


@pytest.mark.parametrize(("costs", "made"), [((5, 4, 3), 3), ((5, 4.5, 3), 2), ((5, 6, 3), 2)])
def test_a_round_is_made_again_while_its_best_is_better_by_the_margin(costs, made):
    """Margin 0.9: 5 → 4 is better, 4.5 is not; and never more often than the row says."""
    left = list(costs)

    def more(objective, found, most):
        return [SimpleNamespace(cost=cost, origin="more") for cost in (left.pop(0), 9)]

    search = Search("", "", (Round((Propose(more),), adds=True, times=3),), "", margin=0.9)
    tried = []
    found = run_rounds(search, SimpleNamespace(), (), Control(), tried=tried)
    assert len(tried) == made
    assert [c.cost for c in found if c.cost != 9] == list(costs[:made])
