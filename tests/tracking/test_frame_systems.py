"""What all frames say, kept as halves of matrices: every part is the whole matrix's, and so is the cost predicted for a step."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack.terms.bone_system import JointSystem
from handtrack.tracking.size import frame_systems
from handtrack.tracking.size.frame_systems import FrameSystems

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
    systems = FrameSystems.empty(FRAMES, SIZE, SHARED)
    for n in reversed(range(FRAMES)):
        own = JointSystem(float(costs[n]), gradients[n], matrices[n])
        systems.put(n, 1.0, own, 0.5 * matrices[n, :SIZE, :SIZE])
    assert_allclose(put_together(systems.own()), matrices[:, :SIZE, :SIZE], rtol=1e-12)
    assert_allclose(put_together(systems.seen()), 0.5 * matrices[:, :SIZE, :SIZE], rtol=1e-12)
    x = rng.normal(size=(FRAMES, whole))
    x[:, SIZE:] = x[0, SIZE:]
    ahead = systems.after(x[:, :SIZE], x[0, SIZE:])
    bent = np.einsum("nij,nj->ni", matrices, x)
    assert_allclose(ahead.costs, costs + (x * (gradients + 0.5 * bent)).sum(axis=1), rtol=1e-12)
    assert_allclose(ahead.gradient, gradients + bent, rtol=1e-10)
