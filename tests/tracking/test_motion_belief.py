"""The belief of place and velocity: a Kalman filter's steps, by hand and against the joint normal distribution."""

import numpy as np
from numpy.testing import assert_allclose

from handtrack.tracking.hypotheses.motion_belief import MotionBelief


def _random_belief(rng, count=3):
    root = rng.normal(size=(2 * count, 2 * count))
    return MotionBelief(rng.normal(size=count), rng.normal(size=count), root @ root.T)


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
