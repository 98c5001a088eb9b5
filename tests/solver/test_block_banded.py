"""The system of many frames, and of what they share: solved as the dense one is, and its inverse where it has blocks."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack.solver import block_banded
from handtrack.solver.block_banded import REACH, Bordered

SIZE = 4


def _add(blocks, first, matrix):
    """Add a matrix over the unknowns of frames that follow one another."""
    size = blocks.shape[-1]
    parts = matrix.reshape(len(matrix) // size, size, -1, size)
    for column in range(len(parts)):
        for row in range(column, len(parts)):
            blocks[first + column, row - column] += parts[row, :, column]


def _system(frames, shared):
    """Return a banded system of frames that look at up to two neighbours, with a border of what they share; and the same as a dense one."""
    rng = np.random.default_rng(frames)
    split = frames * SIZE
    banded, dense = np.zeros((frames, REACH + 1, SIZE, SIZE)), np.zeros((split + shared,) * 2)
    for t in range(frames):
        count = min(REACH + 1, frames - t)
        columns = np.r_[t * SIZE : (t + count) * SIZE, split : split + shared]
        rows = rng.normal(size=(2 * len(columns), len(columns)))
        dense[np.ix_(columns, columns)] += rows.T @ rows
        _add(banded, t, (rows.T @ rows)[: count * SIZE, : count * SIZE])
    border = dense[:split, split:].reshape(frames, SIZE, shared)
    return Bordered.of(banded, lambda at: border[at], dense[split:, split:]), dense


@pytest.mark.parametrize("shared", [0, 1, 5])
@pytest.mark.parametrize("frames", [1, 2, 3, 12])
def test_it_solves_as_the_dense_system_does(rng, frames, shared):
    system, dense = _system(frames, shared)
    right = rng.normal(size=len(dense))
    own, common = np.split(right, [frames * SIZE])
    found = system.solve(own.reshape(frames, SIZE), common)
    together = np.concatenate([part.ravel() for part in found])
    assert_allclose(together, np.linalg.solve(dense, right), rtol=1e-8, atol=1e-10)


def _inverse(system):
    """Return the blocks of all parts."""
    parts = dict(system.inverse_parts())
    return np.concatenate([parts[first] for first in sorted(parts)])


@pytest.mark.parametrize(("at_once", "shared"), [(1, 0), (5, 2), (256, 5)])
@pytest.mark.parametrize("frames", [1, 2, 3, 12])
def test_the_inverse_has_the_dense_one_s_blocks(frames, at_once, shared, monkeypatch):
    monkeypatch.setattr(block_banded, "_AT_ONCE", at_once)
    system, dense = _system(frames, shared)
    exact, split = np.linalg.inv(dense), frames * SIZE
    assert_allclose(system.covariance, exact[split:, split:], rtol=1e-8, atol=1e-12)
    blocks = exact[:split, :split].reshape(frames, SIZE, frames, SIZE)
    found = _inverse(system)
    for t in range(frames):
        for k in range(min(REACH + 1, frames - t)):
            both = found[t, k] + (system.spread(t, k) if shared else 0.0)
            assert_allclose(both, blocks[t + k, :, t], rtol=1e-7, atol=1e-10)


def test_rounding_does_not_grow_along_a_long_recording():
    """Steady motion seen through few combinations: errors that are not symmetric grew threefold a frame."""
    rng = np.random.default_rng(3)
    frames, size = 120, 8
    banded = np.zeros((frames, REACH + 1, size, size))
    mixing = rng.normal(size=(size, size))
    known = np.linalg.inv(mixing @ mixing.T + 0.1 * np.eye(size)) * 1e4
    weights = np.array([0.98, -1.98, 1.0])
    for t in range(frames - 2):
        _add(banded, t, np.kron(np.outer(weights, weights), known))
    for t in range(frames):
        seen = rng.normal(size=(3, size))
        banded[t, 0] += seen.T @ seen + 1e-3 * np.eye(size)
    system = Bordered.of(banded, lambda at: banded[at], np.zeros((0, 0)))
    found = _inverse(system)
    for t in range(0, frames, 10):
        unit = np.zeros((frames, size, size))
        unit[t] = np.eye(size)
        exact = system.alone(unit)[t]
        assert_allclose(found[t, 0], exact, atol=1e-6 * np.abs(exact).max())
