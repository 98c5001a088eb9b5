"""Hypotheses: what counts as the same minimum."""

import numpy as np
import pytest

from handtrack.geometry.rotation import rotation_matrix, rotation_vector
from handtrack.sampling.suppression import angle_distance, distinct


def test_distance_is_the_root_mean_square_of_angles(rng):
    start = rng.normal(size=10)
    moved = start.copy()
    moved[:3] += 5.0  # metres do not count
    moved[6:] += [0.3, -0.4, 0.0, 0.0]
    np.testing.assert_allclose(angle_distance(start, moved[None]), [0.5 / np.sqrt(7)])


def test_the_same_attitude_is_at_no_distance(rng):
    """Rotation vectors 2π apart; and a turn counts by its angle, wherever it starts from."""
    start = np.r_[np.zeros(3), rng.normal(size=3), np.zeros(4)]
    axis = start[3:6] / np.linalg.norm(start[3:6])
    again = start.copy()
    again[3:6] -= 2 * np.pi * axis
    np.testing.assert_allclose(angle_distance(start, again[None]), [0.0], atol=1e-12)
    turned = start.copy()
    turn = rotation_matrix(np.array([0.0, 0.02, 0.0]))
    turned[3:6] = rotation_vector(turn @ rotation_matrix(start[3:6]))
    np.testing.assert_allclose(angle_distance(start, turned[None]), [0.02 / np.sqrt(7)])


@pytest.mark.parametrize("threshold", [0.05, 0.1, 0.3])
def test_distinct_ones_are_apart_and_stand_for_all(rng, threshold):
    params, costs = rng.normal(scale=0.2, size=(80, 12)), rng.normal(size=80)
    kept = distinct(params, costs, threshold)
    for k in kept:
        others = params[kept[kept != k]]
        assert (angle_distance(params[k], others) > threshold).all()
    for n in set(range(80)) - set(kept.tolist()):
        near = kept[angle_distance(params[n], params[kept]) <= threshold]
        assert len(near) and costs[near].min() <= costs[n]
