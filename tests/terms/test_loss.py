"""Robust losses: known values, and weights that are the losses' slopes."""

import numpy as np
import pytest

from handtrack.terms.loss import geman_mcclure, huber, quadratic

LOSSES = [quadratic(), geman_mcclure(3.0), huber(1.5)]


@pytest.mark.parametrize("loss", LOSSES)
def test_small_residuals_count_as_squares(loss):
    tiny = np.array([1e-8])
    np.testing.assert_allclose(loss.value(tiny), tiny, rtol=1e-6)
    np.testing.assert_allclose(loss.weight(tiny), 1.0, rtol=1e-6)


def test_geman_mcclure_saturates():
    loss = geman_mcclure(3.0)
    assert loss.value(np.array([9.0]))[0] == pytest.approx(4.5)  # half of it at one scale
    assert loss.value(np.array([1e8]))[0] == pytest.approx(9.0, rel=1e-6)
    assert loss.weight(np.array([1e8]))[0] < 1e-12


def test_huber_goes_on_straight():
    loss = huber(1.0)
    np.testing.assert_allclose(loss.value(np.array([1.0, 4.0, 9.0])), [1.0, 3.0, 5.0])
    np.testing.assert_allclose(loss.weight(np.array([0.0, 4.0])), [1.0, 0.5])
