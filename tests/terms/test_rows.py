"""Rows become a system: by hand, and several bones in one row."""

import numpy as np

from handtrack.terms.rows import Rows, motion_row
from tests.terms.plain_rows import system_of


def test_a_point_row_by_hand():
    """A point one metre along x from the reference, measured along y: turning about z moves it."""
    row = motion_row(np.array([[2.0, 0, 0]]), np.array([[0.0, 1, 0]]), np.array([1.0, 0, 0]))
    np.testing.assert_array_equal(row, [[0, 1, 0, 0, 0, 1]])


def test_a_point_row_times_a_twist_is_the_points_speed(rng):
    points, normals = rng.normal(size=(2, 5, 3))
    reference, v, w = rng.normal(size=(3, 3))
    speed = ((v + np.cross(w, points - reference)) * normals).sum(axis=1)
    row = motion_row(points, normals, reference)
    np.testing.assert_allclose(row @ np.concatenate([v, w]), speed)


def test_the_system_is_that_of_the_dense_jacobian(rng):
    """Rows that touch no, one and two bones; one bone twice."""
    twist = rng.normal(size=(5, 6))
    row, bone = np.array([0, 2, 2, 3, 3]), np.array([1, 0, 2, 2, 2])
    residual, weight = rng.normal(size=4), rng.uniform(0.1, 1.0, 4)
    dense = np.zeros((4, 18))
    for r, b, t in zip(row, bone, twist, strict=True):
        dense[r, 6 * b : 6 * b + 6] += t
    system = system_of(Rows(residual, row, bone, twist, 1.25, weight), 3)
    assert system.cost == 1.25
    np.testing.assert_allclose(system.gradient, dense.T @ (weight * residual))
    np.testing.assert_allclose(system.hessian, dense.T @ (weight[:, None] * dense), atol=1e-12)
