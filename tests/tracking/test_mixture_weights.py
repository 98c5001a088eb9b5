"""How hypotheses are weighed: Laplace's mass against the mass that numerical integration finds, of those that follow and jump."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import dblquad, quad
from scipy.stats import multivariate_normal, norm

from handtrack import ImageKeypoints, Observation, TrackerSettings, load_model
from handtrack.sampling.chains import Chain, chains_of, prepare
from handtrack.simulation.simulate import simulated_rig
from handtrack.terms.priors.priors import CorrelatedPrior
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.hypotheses import mixture, mixture_search
from handtrack.tracking.hypotheses.mixture import MixtureStep
from handtrack.tracking.hypotheses.mixture_search import (
    Component,
)
from handtrack.tracking.hypotheses.motion_belief import MotionBelief

BALL, HAND = load_model("ball6"), load_model()
NOTHING = Observation(0, 0.0)
SPIN, FACING = 5, 4  # the root's turn about z, and about y
STIFF = [SimpleNamespace(chain=Chain("none", (), ()))]
"""no chain that could jump"""


@pytest.fixture(autouse=True)
def nothing_is_too_alike(monkeypatch):
    monkeypatch.setattr(mixture, "APART_MM", 0.1)


def settings(**values):
    return TrackerSettings().with_values({"tracker.hypotheses": 3} | values)


def frame(model, *priors, keypoints=()):
    """Return a frame that costs what these terms of the parameters cost: the likelihood is known exactly."""
    return FrameTerms(model, settings(), (), (), None, None, keypoints, priors)


def belief(mean, covariance):
    return MotionBelief.at_rest(np.asarray(mean, dtype=float), covariance, np.ones(len(mean)))


def turned(angle, x=0.0):
    params = np.zeros(6)
    params[0], params[SPIN] = x, angle
    return params


def test_two_parameters_that_err_together_are_weighed_together():
    """The same in the plane: bells whose place and angle are correlated, one along what was seen and one across."""
    information = np.zeros((6, 6))
    plane = np.ix_([0, SPIN], [0, SPIN])
    information[plane] = [[60.0, 40.0], [40.0, 60.0]]
    components, masses = [], []
    for angle, slope in ((0.0, 0.8), (0.7, -0.8)):
        spread = np.array([[0.04, 0.04 * slope], [0.04 * slope, 0.04]])
        covariance = np.diag(np.full(6, 1e-4))
        covariance[plane] = spread
        likely = frame(BALL, CorrelatedPrior(turned(0.35), information))
        components.append(Component(belief(turned(angle), covariance), likely, 0.5))
        bell = multivariate_normal([0.0, angle], spread)

        def density(y, x, bell=bell):
            off = np.array([x, y - 0.35])
            return bell.pdf([x, y]) * np.exp(-0.5 * off @ information[plane] @ off)

        masses.append(dblquad(density, -0.8, 0.8, -0.8, 1.6, epsabs=1e-4)[0])
    found = MixtureStep(BALL, settings(), STIFF).next(NOTHING, components)
    weights = dict(zip(found.parents, [h.weight for h in found.hypotheses], strict=True))
    assert weights[0] / weights[1] == pytest.approx(masses[0] / masses[1], rel=1e-2)
    assert abs(masses[0] / masses[1] - 1.0) > 0.3


@pytest.mark.parametrize("share", [0.1, 0.6])
def test_a_jump_weighs_what_a_flat_prior_over_the_chains_range_holds(monkeypatch, share):
    """Of the finger that jumped nothing is known but its limits: ∏ 1/range · ∫ exp(−cost), against the bell that followed."""
    chain = next(c for c in chains_of(HAND) if c.name == "index")
    columns = [HAND.transform.names.index(name) for name in chain.parameters]
    mean, seen = HAND.rest_params(), HAND.rest_params()
    mean[columns], seen[columns] = (0.2, 0.0, 0.2, 0.2), (0.6, 0.05, 0.6, 0.6)
    expected, sharp = 0.05, 0.15
    information = np.zeros(26)
    information[columns] = 1.0 / sharp**2
    variance = np.full(26, 1e-4)
    variance[columns] = expected**2
    last = belief(mean, np.diag(variance))
    terms = frame(HAND, CorrelatedPrior(seen, np.diag(information)))
    camera = simulated_rig(1, (320, 240)).cameras[0]
    unseen = np.full((len(HAND.joint_names), 2), np.nan)
    look = Observation(3, 0.1, keypoints=(ImageKeypoints(camera, HAND.joint_names, unseen, 1.0),))
    monkeypatch.setattr(mixture_search, "JUMP_SHARE", share)
    chosen = settings(**{"mixture.draws": 4})
    step = MixtureStep(HAND, chosen, [prepare(HAND, chain)])
    told = []
    found = step.next(look, [Component(last, terms, 1.0)], Control(on_search=told.append))
    weights = {h.origin: h.weight for h in found.hypotheses}
    (report,) = told
    masses = {trial.origin: np.exp(-trial.cost) for trial in report.rounds[0][1]}
    assert masses["index jumped"] / masses["followed"] == pytest.approx(
        weights["index jumped"] / weights["followed"]
    )

    jumped, followed = share, 1.0 - share
    for column in columns:
        low, high = HAND.bounds(mean)[column]
        at, place = seen[column], mean[column]

        def likelihood(x, at=at):
            return np.exp(-0.5 * ((x - at) / sharp) ** 2)

        def both(x, place=place, likelihood=likelihood):
            return norm.pdf(x, place, expected) * likelihood(x)

        jumped *= quad(likelihood, -4.0, 4.0, points=[at])[0] / (high - low)
        followed *= quad(both, -4.0, 4.0, points=[at, place])[0]
    assert weights.keys() == {"followed", "index jumped"}
    assert weights["index jumped"] / weights["followed"] == pytest.approx(
        jumped / followed, rel=0.01
    )


def test_where_nothing_is_seen_weights_stay_and_what_looks_alike_gives_way(monkeypatch):
    """The middle one is 4 mm from the heaviest in shape: it is no alternative, however heavy beside the third."""
    bells = [(0.5, 0.0), (0.3, 0.1), (0.2, 1.5)]
    components = [
        Component(belief(turned(angle), 1e-4 * np.eye(6)), frame(BALL), w) for w, angle in bells
    ]
    found = MixtureStep(BALL, settings(), STIFF).next(NOTHING, components)
    assert found.parents == (0, 1, 2)
    np.testing.assert_allclose([h.weight for h in found.hypotheses], [0.5, 0.3, 0.2], rtol=1e-6)
    apart = settings(**{"tracker.hypotheses": 2})
    monkeypatch.setattr(mixture, "APART_MM", 20.0)
    found = MixtureStep(BALL, apart, STIFF).next(NOTHING, components)
    assert found.parents == (0, 2)
    np.testing.assert_allclose([h.weight for h in found.hypotheses], [5 / 7, 2 / 7], rtol=1e-6)
    # nothing was seen: the belief neither moved nor became surer
    np.testing.assert_allclose(found.hypotheses[1].params, turned(1.5), atol=1e-6)
