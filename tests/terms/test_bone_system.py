"""Quadratic models add up and pull back like the costs they stand for."""

from __future__ import annotations

import numpy as np

from handtrack.terms.bone_system import BoneSystem, JointSystem


def random_system(rng, bones=3):
    rows = rng.normal(size=(40, 6 * bones))
    residual = rng.normal(size=40)
    return BoneSystem(0.5 * residual @ residual, rows.T @ residual, rows.T @ rows), rows, residual


def test_sums_commute_and_zero_changes_nothing(rng):
    (a, _, _), (b, _, _) = random_system(rng), random_system(rng)
    left, right = a + b, b + a + BoneSystem.zero(3)
    assert left.cost == right.cost
    np.testing.assert_array_equal(left.gradient, right.gradient)
    np.testing.assert_array_equal(left.hessian, right.hessian)


def test_pull_back_is_the_system_of_the_chained_jacobian(rng):
    system, rows, residual = random_system(rng)
    twist, matrix = rng.normal(size=(3, 6, 7)), rng.normal(size=(7, 4))
    params = system.pull_back(twist).pull_back(matrix)
    jacobian = rows @ twist.reshape(18, 7) @ matrix
    assert isinstance(params, JointSystem)
    assert params.cost == system.cost
    np.testing.assert_allclose(params.gradient, jacobian.T @ residual, atol=1e-11)
    np.testing.assert_allclose(params.hessian, jacobian.T @ jacobian, atol=1e-11)
