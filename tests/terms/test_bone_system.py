"""Quadratic models add up and pull back like the costs they stand for."""

from __future__ import annotations

import numpy as np
import pytest

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


def test_pull_back_commutes_with_sums(rng):
    (a, _, _), (b, _, _) = random_system(rng), random_system(rng)
    twist = rng.normal(size=(3, 6, 7))
    one, two = (a + b).pull_back(twist), a.pull_back(twist) + b.pull_back(twist)
    np.testing.assert_allclose(one.hessian, two.hessian, atol=1e-11)
    np.testing.assert_allclose(one.gradient, two.gradient, atol=1e-11)


def test_scaled_multiplies_all_three(rng):
    system, _, _ = random_system(rng)
    half = system.scaled(0.5)
    assert half.cost == pytest.approx(0.5 * system.cost)
    np.testing.assert_allclose(2 * half.gradient, system.gradient)
    np.testing.assert_allclose(2 * half.hessian, system.hessian)
