"""Priors: known costs, what is free, and how they and couplings meet."""

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.terms.priors.priors import CorrelatedPrior, GaussianPrior
from handtrack.tracking.frame.terms.posture import posture_prior
from tests.derivatives import check_parameter_term


def test_a_standard_deviation_costs_a_half():
    prior = GaussianPrior(np.zeros(3), np.array([0.5, np.inf, 2.0]))
    assert prior.cost(np.array([0.5, 99.0, 0.0])) == pytest.approx(0.5)
    system = prior.linearize(np.array([0.5, 99.0, 4.0]))
    assert system.cost == pytest.approx(2.5)
    np.testing.assert_allclose(system.gradient, [2.0, 0.0, 1.0])
    np.testing.assert_allclose(system.hessian, np.diag([4.0, 0.0, 0.25]))


def test_a_bell_without_correlations_is_the_plain_prior(rng):
    sigma, x = np.array([0.5, 0.1, 2.0]), rng.normal(size=3)
    correlated, plain = (
        CorrelatedPrior(np.ones(3), np.diag(1 / sigma**2)),
        GaussianPrior(np.ones(3), sigma),
    )
    assert correlated.cost(x) == pytest.approx(plain.cost(x))
    np.testing.assert_allclose(correlated.linearize(x).gradient, plain.linearize(x).gradient)
    np.testing.assert_allclose(correlated.linearize(x).hessian, plain.linearize(x).hessian)


@pytest.mark.parametrize("strength", [0.25, 1.0])
def test_the_posture_prior_at_random_angles(rng, strength):
    model = load_model()
    prior = posture_prior(model, strength)
    assert prior is not None
    check_parameter_term(prior, rng.normal(size=26), model.parameter_names)
    one = posture_prior(model, 1.0)
    assert one is not None
    x = rng.normal(size=26)
    assert prior.cost(x) == pytest.approx(strength * one.cost(x))


def test_the_last_joint_is_tied_to_the_middle_one_the_less_the_more_that_bends():
    """A finger's last joint 20° beside two thirds of the middle one, all fingers alike: the more these bend, the less it costs."""
    model = load_model()
    prior = posture_prior(model, 1.0)
    assert prior is not None

    def costs(bent_deg, off_deg):
        evenly = np.zeros(len(model.parameter_names))
        for finger in ("index", "middle", "ring", "little"):
            for joint, deg in (
                ("mcp", bent_deg),
                ("pip", bent_deg),
                ("dip", 2 / 3 * bent_deg + off_deg),
            ):
                evenly[model.parameter_names.index(f"{finger}_{joint}_flex")] = np.deg2rad(deg)
        return prior.cost(evenly)

    assert costs(0.0, -20.0) == pytest.approx(4 * 0.5 * (20 / 14) ** 2)
    assert (
        costs(0.0, -20.0)
        > costs(45.0, -20.0)
        > costs(90.0, -20.0)
        == pytest.approx(4 * 0.5 * 20**2 / (14**2 + 18**2))
    )
