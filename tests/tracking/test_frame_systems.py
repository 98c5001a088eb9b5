"""What all frames say, kept as halves of matrices: every part is the whole matrix's, and so is the cost predicted for a step."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack.terms.bone_system import JointSystem
from handtrack.tracking.size import frame_systems
from handtrack.tracking.size.frame_systems import FrameSystem, FrameSystems

FRAMES, SIZE, SHARED = 5, 4, 3


def put_together(parts):
    found = np.zeros((FRAMES, SIZE, SIZE))
    for at, blocks in parts:
        found[at] = blocks
    return found


@pytest.mark.parametrize("at_once", [2, 256])
def test_it_is_the_whole_matrix_read_in_parts_or_at_once(rng, monkeypatch, at_once):
    monkeypatch.setattr(frame_systems, "_AT_ONCE", at_once)
    whole = SIZE + SHARED
    costs, gradients = rng.normal(size=FRAMES), rng.normal(size=(FRAMES, whole))
    roots = rng.normal(size=(FRAMES, whole, whole))
    matrices = roots @ np.swapaxes(roots, 1, 2)
    seen = 0.5 * matrices[:, :SIZE, :SIZE]
    systems = FrameSystems.empty(FRAMES, SIZE, SHARED)
    for n in reversed(range(FRAMES)):
        own = JointSystem(float(costs[n]), gradients[n], matrices[n])
        systems.put(n, FrameSystem(own, seen[n]))
    for found, expected in (
        (put_together(systems.own()), matrices[:, :SIZE, :SIZE]),
        (put_together(systems.seen()), seen),
        (systems.costs, costs),
        (systems.gradient, gradients),
        (systems.border, matrices[:, :SIZE, SIZE:]),
        (systems.corner, matrices[:, SIZE:, SIZE:].sum(axis=0)),
    ):
        assert_allclose(found, expected, rtol=1e-12)
    x = rng.normal(size=(FRAMES, whole))
    x[:, SIZE:] = x[0, SIZE:]
    expected = costs + (gradients * x).sum(axis=1) + 0.5 * np.einsum("ni,nij,nj->n", x, matrices, x)
    ahead = systems.after(x[:, :SIZE], x[0, SIZE:])
    assert_allclose(ahead.costs, expected, rtol=1e-12)
    slopes = gradients + np.einsum("nij,nj->ni", matrices, x)
    assert_allclose(ahead.gradient, slopes, rtol=1e-10)
    assert_array_equal(systems.costs, costs)
    twice = ahead.after(x[:, :SIZE], x[0, SIZE:])
    bent = 2.0 * np.einsum("ni,nij,nj->n", x, matrices, x)
    assert_allclose(twice.extrapolated, bent, rtol=1e-10)
    twice.put(1, FrameSystem(JointSystem(0.0, gradients[1], matrices[1]), seen[1]))
    assert np.flatnonzero(twice.extrapolated == 0.0).tolist() == [1]
