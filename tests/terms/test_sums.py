"""What sums are made of: rows, bone systems, losses and priors."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import load_model
from handtrack.model.articulated import FINGERS
from handtrack.terms.loss import huber
from handtrack.terms.priors import GaussianPrior
from handtrack.tracking.frame.terms.priors import posture_prior


def test_huber_goes_on_straight():
    loss = huber(1.0)
    assert_allclose(loss.value(np.array([1.0, 4.0, 9.0])), [1.0, 3.0, 5.0])
    assert_allclose(loss.weight(np.array([0.0, 4.0])), [1.0, 0.5])


def test_a_standard_deviation_costs_a_half():
    prior = GaussianPrior(np.zeros(3), np.array([0.5, np.inf, 2.0]))
    assert prior.cost(np.array([0.5, 99.0, 0.0])) == pytest.approx(0.5)
    system = prior.linearize(np.array([0.5, 99.0, 4.0]))
    assert system.cost == pytest.approx(2.5)
    assert_allclose(system.gradient, [2.0, 0.0, 1.0])
    assert_allclose(system.hessian, np.diag([4.0, 0.0, 0.25]))


def test_the_last_joint_is_tied_to_the_middle_one_the_less_the_more_that_bends():
    """A finger's last joint 20° beside two thirds of the middle one, all fingers alike: the more these bend, the less it costs."""
    model = load_model()

    def cost(bent_deg, strength=1.0):
        angles = {"mcp": bent_deg, "pip": bent_deg, "dip": 2 / 3 * bent_deg - 20.0}
        evenly = {
            f"{f}_{j}_flex": np.deg2rad(deg) for f in FINGERS[1:] for j, deg in angles.items()
        }
        return posture_prior(model, strength).cost(model.params_from(evenly))

    straight, fist = 4 * 0.5 * (20 / 14) ** 2, 4 * 0.5 * 20**2 / (14**2 + 18**2)
    assert [cost(0.0), cost(90.0)] == pytest.approx([straight, fist])
    assert straight > cost(45.0) > fist
    assert cost(0.0, 0.25) == pytest.approx(0.25 * straight)
