"""The belief of place and velocity: a Kalman filter's steps, by hand and against the joint normal distribution."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack.tracking.hypotheses.motion_belief import MotionBelief


def _random_belief(rng, count=3):
    root = rng.normal(size=(2 * count, 2 * count))
    return MotionBelief(rng.normal(size=count), rng.normal(size=count), root @ root.T)


def test_motion_goes_on_and_grows_less_certain():
    at_rest = MotionBelief.at_rest(np.array([1.0]), np.array([[0.04]]), np.array([0.3]))
    belief, push = replace(at_rest, velocity=np.array([2.0])), np.array([0.1])
    moved, held = belief.ahead(push, 1), belief.ahead(push, 2, moving=False)
    assert (moved.mean[0], moved.velocity[0], held.mean[0]) == (3.0, 2.0, 1.0)
    assert_allclose(moved.covariance, [[0.04 + 0.09 + 0.0025, 0.095], [0.095, 0.1]])
    assert held.covariance[0, 0] == pytest.approx(0.04 + 2 * 0.01)


def test_an_update_is_conditioning_the_joint_normal(rng):
    """A measurement of the place, fused by hand in information form, against `updated`."""
    belief = _random_belief(rng)
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


def test_released_parameters_forget_and_the_others_do_not(rng):
    belief = _random_belief(rng)
    spread, speed = np.full(3, 1.5), np.full(3, 0.2)
    freed = belief.released(np.array([1]), spread, speed)
    assert_array_equal(freed.velocity, belief.velocity * [1.0, 0.0, 1.0])
    kept = ~np.isin(np.arange(6), [1, 4])
    expected = (
        belief.covariance * np.outer(kept, kept) + np.diag(~kept * [0, 1.5, 0, 0, 0.2, 0]) ** 2
    )
    assert_allclose(freed.covariance, expected)
