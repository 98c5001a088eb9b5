"""The belief of place and velocity: a Kalman filter's steps, by hand and against the joint normal distribution."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack.tracking.hypotheses.motion_belief import MotionBelief


def _random_belief(rng, count=3):
    root = rng.normal(size=(2 * count, 2 * count))
    return MotionBelief(rng.normal(size=count), rng.normal(size=count), root @ root.T)


def test_motion_goes_on_and_grows_less_certain():
    belief = MotionBelief.at_rest(np.array([1.0]), np.array([[0.04]]), np.array([0.3]))
    moved = MotionBelief(belief.mean, np.array([2.0]), belief.covariance).ahead(np.array([0.1]), 1)
    assert moved.mean[0] == 3.0
    assert moved.velocity[0] == 2.0
    assert_allclose(
        moved.covariance, [[0.04 + 0.09 + 0.0025, 0.09 + 0.005], [0.09 + 0.005, 0.09 + 0.01]]
    )
    held = MotionBelief(belief.mean, np.array([2.0]), belief.covariance).ahead(
        np.array([0.1]), 2, moving=False
    )
    assert held.mean[0] == 1.0
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
