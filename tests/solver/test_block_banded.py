"""The system of many frames, and of what they share: solved as the dense one is, and its inverse where it has blocks."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack.solver import block_banded
from handtrack.solver.block_banded import REACH, BlockBanded, Bordered


def _system(frames, size, seed=0):
    """Return a banded matrix that has a factor, and the same as a dense one."""
    rng = np.random.default_rng(seed)
    banded = BlockBanded.zero(frames, size)
    dense = np.zeros((frames * size, frames * size))
    for t in range(frames):
        for count in range(1, REACH + 2):
            if t + count > frames:
                continue
            rows = rng.normal(size=(size + 2, count * size))
            matrix = rows.T @ rows + 0.1 * np.eye(count * size)
            banded.add(np.arange(t, t + count), matrix)
            part = slice(t * size, (t + count) * size)
            dense[part, part] += matrix
    return banded, dense


@pytest.mark.parametrize("frames", [1, 2, 3, 12])
def test_it_solves_as_the_dense_system_does(frames):
    banded, dense = _system(frames, 4)
    right = np.random.default_rng(1).normal(size=(frames, 4, 3))
    found = banded.factor().solve(right)
    assert_allclose(
        found.reshape(frames * 4, 3), np.linalg.solve(dense, right.reshape(frames * 4, 3)), rtol=1e-8, atol=1e-10
    )  # fmt: skip


def _inverse(banded):
    """Return the blocks of all parts."""
    parts = dict(banded.factor().inverse_parts())
    return np.concatenate([parts[first] for first in sorted(parts)])


@pytest.mark.parametrize("at_once", [1, 5, 256])
@pytest.mark.parametrize("frames", [1, 2, 3, 12])
def test_the_inverse_has_the_dense_one_s_blocks(frames, at_once, monkeypatch):
    monkeypatch.setattr(block_banded, "_AT_ONCE", at_once)
    banded, dense = _system(frames, 4)
    inverse = np.linalg.inv(dense).reshape(frames, 4, frames, 4)
    found = _inverse(banded)
    for t in range(frames):
        for k in range(min(REACH + 1, frames - t)):
            assert_allclose(found[t, k], inverse[t + k, :, t], rtol=1e-7, atol=1e-10)


def test_rounding_does_not_grow_along_a_long_recording():
    """Steady motion seen through few combinations: errors that are not symmetric grew threefold a frame."""
    rng = np.random.default_rng(3)
    frames, size = 120, 8
    banded = BlockBanded.zero(frames, size)
    mixing = rng.normal(size=(size, size))
    known = np.linalg.inv(mixing @ mixing.T + 0.1 * np.eye(size)) * 1e4
    weights = np.array([0.98, -1.98, 1.0])
    for t in range(frames - 2):
        banded.add(np.arange(t, t + 3), np.kron(np.outer(weights, weights), known))
    for t in range(frames):
        seen = rng.normal(size=(3, size))
        banded.blocks[t, 0] += seen.T @ seen + 1e-3 * np.eye(size)
    found = _inverse(banded)
    for t in range(0, frames, 10):
        unit = np.zeros((frames, size, size))
        unit[t] = np.eye(size)
        exact = banded.factor().solve(unit)[t]
        assert_allclose(found[t, 0], exact, atol=1e-6 * np.abs(exact).max())


FRAMES, SIZE = 7, 4


def _bordered(shared, seed=2):
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
def test_with_what_is_shared_it_solves_as_the_dense_system_does(shared):
    system, dense = _bordered(shared)
    right = np.random.default_rng(1).normal(size=len(dense))
    split = FRAMES * SIZE
    frames, found = system.solve(right[:split].reshape(FRAMES, SIZE), right[split:])
    expected = np.linalg.solve(dense, right)
    assert_allclose(frames.ravel(), expected[:split], rtol=1e-8, atol=1e-10)
    assert_allclose(found, expected[split:], rtol=1e-8, atol=1e-10)


def test_its_covariances_with_what_is_shared_are_the_dense_one_s():
    system, dense = _bordered(5)
    exact, split = np.linalg.inv(dense), FRAMES * SIZE
    assert_allclose(system.covariance, exact[split:, split:], rtol=1e-8, atol=1e-12)
    blocks = exact[:split, :split].reshape(FRAMES, SIZE, FRAMES, SIZE)
    _, inverse = next(system.frames.inverse_parts())
    for t in range(FRAMES):
        for k in range(min(3, FRAMES - t)):
            found = inverse[t, k] + system.spread(t, k)
            assert_allclose(found, blocks[t + k, :, t], rtol=1e-7, atol=1e-10)
