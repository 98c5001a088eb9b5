"""Quadratic models add up and pull back like the costs they stand for."""

import numpy as np

from handtrack.terms.bone_kernels import pull_back
from handtrack.terms.bone_system import JointSystem, Sums


def random_sums(rng, width, bones=4):
    """Return sums in which bone 3 has no residual, and bones 0 and 1 none in common."""
    rows = rng.normal(size=(40, width * bones))
    rows[:, 3 * width :] = 0.0
    rows[:20, :width], rows[20:, width : 2 * width] = 0.0, 0.0
    residual = rng.normal(size=40)
    return Sums(width, rows.T @ residual, rows.T @ rows), rows, residual


def test_pull_back_is_the_system_of_the_chained_jacobian(rng):
    for width in (3, 6, 12):
        sums, rows, residual = random_sums(rng, width)
        motion, matrix = rng.normal(size=(4, width, 7)), rng.normal(size=(7, 4))
        system = JointSystem(2.0, *pull_back(sums, motion)).pull_back(matrix)
        jacobian = rows @ motion.reshape(-1, 7) @ matrix
        assert system.cost == 2.0
        np.testing.assert_allclose(system.gradient, jacobian.T @ residual, atol=1e-10)
        np.testing.assert_allclose(system.hessian, jacobian.T @ jacobian, atol=1e-10)
