"""How hypotheses are weighed: Laplace's mass against known ones, of those that follow and jump; and the belief that each carries, by hand."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import multivariate_normal, norm

from handtrack import ImageKeypoints, Observation, TrackerSettings, load_model
from handtrack.sampling.chains import chains_of
from handtrack.simulation.simulate import simulated_rig
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.priors import CorrelatedPrior, GaussianPrior, LinearPrior
from handtrack.terms.term import ParameterTerm
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.motion_belief import MotionBelief
from handtrack.tracking.hypotheses import mixture
from handtrack.tracking.hypotheses.mixture import (
    MixtureObjective,
    Source,
    searched,
    without_memory,
)
from tests.tracking.scenes import Told

BALL, HAND = load_model("ball6"), load_model()
NOTHING = Observation(0, 0.0)
SPIN, FACING = 5, 4  # the root's turn about z, and about y


@pytest.fixture(autouse=True)
def nothing_is_too_alike(monkeypatch):
    monkeypatch.setattr(mixture, "APART_MM", 0.1)


def settings(**values):
    return TrackerSettings().with_values({"tracker.hypotheses": 3} | values)


def frame(model, *priors, keypoints=()):
    """Return a frame that costs what these terms of the parameters cost: the likelihood is known exactly."""
    return FrameTerms(model, settings(), NOTHING, (), (), None, None, keypoints, priors)


def component(mean, covariance, terms, weight=1.0, number=0):
    expected = MotionBelief.at_rest(mean, covariance, np.ones(len(mean)))
    return Source("followed", terms, 12, expected, number, float(np.log(weight)))


def carried_on(components, **values):
    task = BALL, settings(**values), NOTHING, np.zeros(6)
    return searched(MixtureObjective(*task, components=components))[1]


def turned(angle):
    params = np.zeros(6)
    params[SPIN] = angle
    return params


def test_two_parameters_that_err_together_are_weighed_together():
    """Bells in the plane whose place and angle are correlated, one along what was seen and one across: masses in closed form."""
    information, plane = np.zeros((6, 6)), np.ix_([0, SPIN], [0, SPIN])
    information[plane] = [[60.0, 40.0], [40.0, 60.0]]
    components, masses = [], []
    for angle, slope in ((0.0, 0.8), (0.7, -0.8)):
        covariance = np.diag(np.full(6, 1e-4))
        covariance[plane] = 0.04 * np.array([[1.0, slope], [slope, 1.0]])
        likely = frame(BALL, CorrelatedPrior(turned(0.35), information))
        components.append(component(turned(angle), covariance, likely, 0.5, len(masses)))
        both = covariance[plane] + np.linalg.inv(information[plane])
        masses.append(multivariate_normal([0.0, angle], both).pdf([0.0, 0.35]))
    weights = {h.parent: h.weight for h in carried_on(components)}
    assert weights[0] / weights[1] == pytest.approx(masses[0] / masses[1], rel=1e-2)
    assert abs(masses[0] / masses[1] - 1.0) > 0.3


@pytest.mark.parametrize("share", [0.1, 0.6])
def test_a_jump_weighs_what_a_flat_prior_over_the_chains_range_holds(monkeypatch, share):
    """Of the finger that jumped nothing is known but its limits: ∏ 1/range · ∫ exp(−cost), against the Gaussian that followed, both in closed form."""
    chain = next(c for c in chains_of(HAND) if c.name == "index")
    columns = [HAND.transform.names.index(name) for name in chain.parameters]
    mean, seen = HAND.rest_params(), HAND.rest_params()
    mean[columns], seen[columns] = (0.2, 0.0, 0.2, 0.2), (0.6, 0.05, 0.6, 0.6)
    expected, sharp = 0.05, 0.15
    information = np.zeros(26)
    information[columns] = 1.0 / sharp**2
    variance = np.full(26, 1e-4)
    variance[columns] = expected**2
    terms = frame(HAND, CorrelatedPrior(seen, np.diag(information)))
    camera = simulated_rig(1, (320, 240)).cameras[0]
    unseen = np.full((len(HAND.joint_names), 2), np.nan)
    look = Observation(3, 0.1, keypoints=(ImageKeypoints(camera, HAND.joint_names, unseen, 1.0),))
    monkeypatch.setattr(mixture, "JUMP_SHARE", share)
    chosen = settings(**{"mixture.draws": 4, "mixture.chains": ("index",)})
    told = Told()
    last = component(mean, np.diag(variance), terms)
    task = {"control": Control(observer=told), "components": [last]}
    _, found = searched(MixtureObjective(HAND, chosen, look, mean, **task))
    weights = {h.origin: h.weight for h in found}
    (report,) = told
    masses = {origin: np.exp(-cost) for origin, cost in report.rounds[0][1]}
    assert masses["index jumped"] / masses["followed"] == pytest.approx(
        weights["index jumped"] / weights["followed"]
    )

    low, high = HAND.bounds(mean)[columns].T
    gaussians = norm.pdf(seen[columns], mean[columns], np.hypot(expected, sharp))
    ratio = share / (1.0 - share) / np.prod((high - low) * gaussians)
    assert weights.keys() == {"followed", "index jumped"}
    assert weights["index jumped"] / weights["followed"] == pytest.approx(ratio, rel=0.01)


def test_a_chain_jumps_as_probably_as_it_is_voted_for(monkeypatch):
    """The prior of its jumps is in proportion to its vote."""
    camera, rest = simulated_rig(1, (320, 240)).cameras[0], HAND.rest_params()
    pixels = camera.project(HAND.joint_positions(HAND.bones(rest)))
    seen = ImageKeypoints(camera, HAND.joint_names, pixels, 1.0)
    look = Observation(3, 0.0, keypoints=(seen,))
    last = component(rest, 1e-4 * np.eye(26), frame(HAND))

    def log_priors(votes):
        monkeypatch.setattr(mixture, "chain_votes", lambda *_: np.array(votes))
        chosen = settings(**{"mixture.draws": 16, "mixture.chains": ("index", "ring")})
        following = MixtureObjective(HAND, chosen, look, rest, components=[last])
        return {c.origin: c.source.log_prior for c in following.kinematic_jumps([], 0)}

    even, uneven = log_priors([0.5, 0.5]), log_priors([0.2, 0.8])
    for name, factor in (("index jumped", 0.4), ("ring jumped", 1.6)):
        assert uneven[name] - even[name] == pytest.approx(np.log(factor))


def test_where_nothing_is_seen_weights_stay_and_what_looks_alike_gives_way(monkeypatch):
    """The middle one is 4 mm from the heaviest in shape: it is no alternative, however heavy beside the third."""
    gaussians = [(0.5, 0.0), (0.3, 0.1), (0.2, 1.5)]
    components = [
        component(turned(angle), 1e-4 * np.eye(6), frame(BALL), w, n)
        for n, (w, angle) in enumerate(gaussians)
    ]
    found = carried_on(components)
    assert [h.parent for h in found] == [0, 1, 2]
    assert_allclose([h.weight for h in found], [0.5, 0.3, 0.2], rtol=1e-6)
    monkeypatch.setattr(mixture, "APART_MM", 20.0)
    found = carried_on(components, **{"tracker.hypotheses": 2})
    assert [h.parent for h in found] == [0, 2]
    assert_allclose([h.weight for h in found], [5 / 7, 2 / 7], rtol=1e-6)
    # nothing was seen: the belief neither moved nor became surer
    assert_allclose(found[1].parameters, turned(1.5), atol=1e-6)


@dataclass(frozen=True)
class Wells(ParameterTerm):
    """The least of Gaussians, each with a cost of its own."""

    wells: tuple[tuple[float, GaussianPrior], ...]
    name: str = "wells"

    def add_to(self, joint_params, sums):
        least, gaussian = min(self.wells, key=lambda well: well[0] + well[1].cost(joint_params))
        return least + gaussian.add_to(joint_params, sums)


def well(angle, cost, sigma):
    """Return a minimum of where the root faces; other parameters are held near 0."""
    facing = np.eye(6)[FACING]
    return cost, GaussianPrior(angle * facing, np.where(facing, sigma, 0.1))


def test_of_a_first_frame_costs_alone_decide():
    """Nothing came before, so there is no prior to integrate: weights are exp(−cost), however wide a minimum is."""
    terms = frame(BALL, Wells((well(0.2, 1.0, 0.1), well(1.4, 2.0, 0.5), well(-1.5, 2.5, 0.1))))
    told = Told()
    first = [Source("start", terms, 12)]
    task = {"control": Control(observer=told), "components": first}
    _, found = searched(MixtureObjective(BALL, settings(), NOTHING, np.zeros(6), **task))
    assert_allclose([h.parameters[FACING] for h in found], [0.2, 1.4, -1.5], atol=1e-3)
    weights = np.exp([-1.0, -2.0, -2.5])
    assert_allclose([h.weight for h in found], weights / weights.sum(), rtol=1e-3)
    assert {h.parent for h in found} == {-1}
    (report,) = told
    assert [count for count, _ in report.rounds] == [4, 5, 0]  # nothing to be seen: no trees
    assert report.winner == ("start", pytest.approx(1.0))


def test_ten_frames_count_static_priors_once_and_what_was_seen_ten_times():
    x = np.linspace(-0.4, 0.5, 6)
    rest, linked = GaussianPrior(np.zeros(6), np.full(6, 0.3), "rest"), LinearPrior(np.eye(6) / 0.2)
    sharing = without_memory(frame(BALL, rest, linked, CorrelatedPrior(np.zeros(6), np.eye(6))))
    shares = [prior.cost(x) for prior in sharing.priors]
    assert_allclose(shares, [0.1 * rest.cost(x), 0.1 * linked.cost(x), 0.5 * x @ x])


def test_joints_in_images_count_by_what_is_new_in_them_and_seen_coarsely_by_a_hundredth():
    camera, bones = simulated_rig(1, (320, 240)).cameras[0], HAND.bones(HAND.rest_params())
    pixels = camera.project(HAND.joint_positions(bones)) + 2.0
    term = KeypointTerm(HAND, ImageKeypoints(camera, HAND.joint_names, pixels, 1.0))
    terms = frame(HAND, keypoints=(term,))
    (whole,) = without_memory(terms).keypoints
    assert whole.cost(bones) == term.cost(bones)
    lasting = replace(terms.settings, traits=replace(terms.settings.traits, new_share=0.25))
    (once,) = without_memory(replace(terms, settings=lasting)).keypoints
    assert once.cost(bones) == pytest.approx(0.25 * term.cost(bones))
    (wide,) = terms.coarser(10.0).keypoints
    assert wide.cost(bones) == pytest.approx(term.cost(bones) / 100.0)


def test_depth_is_flipped_in_the_camera_that_sees_most_joints_sure_or_not():
    first, second = simulated_rig(2, (320, 240)).cameras
    places = HAND.joint_positions(HAND.bones(HAND.rest_params()))
    pixels, other = first.project(places), second.project(places)
    pixels[0], other[:6] = np.nan, np.nan
    sigma = np.linspace(1.0, 30.0, len(places))
    joints = (
        ImageKeypoints(second, HAND.joint_names, other, 1.0),
        ImageKeypoints(first, HAND.joint_names[::-1], pixels[::-1], sigma),
    )
    seen = Observation(0, 0.0, keypoints=joints)
    reference = MixtureObjective(HAND, settings(), seen, HAND.rest_params()).reference
    assert reference is not None
    camera, places = reference
    assert camera is first
    assert_allclose(places, pixels)


@pytest.fixture
def belief(rng):
    root = rng.normal(size=(6, 6))
    return MotionBelief(rng.normal(size=3), rng.normal(size=3), root @ root.T)


def test_motion_goes_on_and_grows_less_certain():
    at_rest = MotionBelief.at_rest(np.array([1.0]), np.array([[0.04]]), np.array([0.3]))
    belief, push = replace(at_rest, velocity=np.array([2.0])), np.array([0.1])
    moved, held = belief.ahead(push, 1), belief.ahead(push, 2, moving=False)
    assert (moved.mean[0], moved.velocity[0], held.mean[0]) == (3.0, 2.0, 1.0)
    assert_allclose(moved.covariance, [[0.04 + 0.09 + 0.0025, 0.095], [0.095, 0.1]])
    assert held.covariance[0, 0] == pytest.approx(0.04 + 2 * 0.01)


def test_an_update_is_conditioning_the_joint_normal(rng, belief):
    """A measurement of the place, fused by hand in information form, against `updated`."""
    noise, seen = np.diag([0.5, 0.2, 0.9]), rng.normal(size=3)
    look = np.hstack([np.eye(3), np.zeros((3, 3))])
    information = np.linalg.inv(belief.covariance) + look.T @ np.linalg.inv(noise) @ look
    whole = np.linalg.inv(information)
    before = np.concatenate([belief.mean, belief.velocity])
    after = whole @ (
        np.linalg.inv(belief.covariance) @ before + look.T @ np.linalg.inv(noise) @ seen
    )
    found = belief.updated(after[:3], whole[:3, :3])
    assert_allclose(found.velocity, after[3:], atol=1e-9)
    assert_allclose(found.covariance, whole, atol=1e-9)


def test_released_parameters_forget_and_the_others_do_not(belief):
    spread, speed = np.full(3, 1.5), np.full(3, 0.2)
    freed = belief.released(np.array([1]), spread, speed)
    assert_array_equal(freed.velocity, belief.velocity * [1.0, 0.0, 1.0])
    kept = ~np.isin(np.arange(6), [1, 4])
    expected = (
        belief.covariance * np.outer(kept, kept) + np.diag(~kept * [0, 1.5, 0, 0, 0.2, 0]) ** 2
    )
    assert_allclose(freed.covariance, expected)
