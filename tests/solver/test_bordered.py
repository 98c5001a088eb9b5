"""Frames and what they share: solved as the dense system is, with its inverse's blocks."""

import numpy as np
import pytest

from handtrack.solver.block_banded import BlockBanded, Bordered

FRAMES, SIZE = 7, 4


def _system(shared, seed=2):
    """Return a bordered system of frames that look at themselves and their two neighbours, and the same as a dense one."""
    rng = np.random.default_rng(seed)
    banded, total = BlockBanded.zero(FRAMES, SIZE), FRAMES * SIZE + shared
    dense = np.zeros((total, total))
    for t in range(FRAMES - 2):
        columns = [*range(t * SIZE, (t + 3) * SIZE), *range(FRAMES * SIZE, total)]
        rows = rng.normal(size=(2 * SIZE + shared, len(columns)))
        matrix = rows.T @ rows + 0.1 * np.eye(len(columns))
        dense[np.ix_(columns, columns)] += matrix
        banded.add(np.arange(t, t + 3), matrix[: 3 * SIZE, : 3 * SIZE])
    split = FRAMES * SIZE
    border = dense[:split, split:].reshape(FRAMES, SIZE, shared)
    return Bordered(banded.factor(), border, dense[split:, split:]), dense


@pytest.mark.parametrize("shared", [0, 1, 5])
def test_it_solves_as_the_dense_system_does(shared):
    system, dense = _system(shared)
    right = np.random.default_rng(1).normal(size=len(dense))
    split = FRAMES * SIZE
    frames, found = system.solve(right[:split].reshape(FRAMES, SIZE), right[split:])
    expected = np.linalg.solve(dense, right)
    np.testing.assert_allclose(frames.ravel(), expected[:split], rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found, expected[split:], rtol=1e-8, atol=1e-10)


def test_its_covariances_are_the_dense_one_s():
    system, dense = _system(5)
    exact, split = np.linalg.inv(dense), FRAMES * SIZE
    np.testing.assert_allclose(system.covariance, exact[split:, split:], rtol=1e-8, atol=1e-12)
    blocks = exact[:split, :split].reshape(FRAMES, SIZE, FRAMES, SIZE)
    _, inverse = next(system.frames.inverse_parts())
    for t in range(FRAMES):
        for k in range(min(3, FRAMES - t)):
            found = inverse[t, k] + system.spread(t, k)
            np.testing.assert_allclose(found, blocks[t + k, :, t], rtol=1e-7, atol=1e-10)
