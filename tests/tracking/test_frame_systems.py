"""What all frames say, kept as halves of matrices: the same as whole ones, in parts as at once."""

import numpy as np
import pytest

from handtrack.terms.bone_system import JointSystem
from handtrack.tracking.size import frame_systems
from handtrack.tracking.size.frame_systems import FrameSystem, FrameSystems

FRAMES, SIZE, SHARED = 5, 4, 3


@pytest.fixture(params=[2, 256])
def kept(request, rng, monkeypatch):
    """Return systems as they are kept, and costs, gradients, matrices and what was seen of them; read in parts, or at once."""
    monkeypatch.setattr(frame_systems, "_AT_ONCE", request.param)
    whole = SIZE + SHARED
    costs, gradients = rng.normal(size=FRAMES), rng.normal(size=(FRAMES, whole))
    roots = rng.normal(size=(FRAMES, whole, whole))
    matrices = roots @ np.swapaxes(roots, 1, 2)
    seen = 0.5 * matrices[:, :SIZE, :SIZE]
    systems = FrameSystems.empty(FRAMES, SIZE, SHARED)
    for n in reversed(range(FRAMES)):
        own = JointSystem(float(costs[n]), gradients[n], matrices[n])
        systems.put(n, FrameSystem(own, seen[n]))
    return systems, costs, gradients, matrices, seen


def test_every_part_is_the_whole_matrix_s(kept):
    systems, costs, gradients, matrices, seen = kept
    np.testing.assert_array_equal(systems.costs, costs)
    np.testing.assert_array_equal(systems.gradient, gradients)
    for part, expected in ((systems.own(), matrices[:, :SIZE, :SIZE]), (systems.seen(), seen)):
        found = np.zeros_like(expected)
        for at, blocks in part:
            found[at] = blocks
        np.testing.assert_allclose(found, expected, rtol=1e-14)
    np.testing.assert_allclose(systems.border, matrices[:, :SIZE, SIZE:], rtol=1e-14)
    np.testing.assert_allclose(systems.corner, matrices[:, SIZE:, SIZE:].sum(axis=0), rtol=1e-12)


def test_what_a_step_should_cost_is_the_quadratic_s(kept, rng):
    systems, costs, gradients, matrices, _ = kept
    step, shared = rng.normal(size=(FRAMES, SIZE)), rng.normal(size=SHARED)
    for n, found in enumerate(systems.foretold(step, shared)):
        x = np.concatenate([step[n], shared])
        expected = costs[n] + gradients[n] @ x + 0.5 * x @ matrices[n] @ x
        assert found == pytest.approx(expected, rel=1e-12)
