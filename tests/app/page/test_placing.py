"""Nudges along the view: right is right in the picture, and turning leaves the hand's middle where it is."""

import numpy as np
import pytest

from handtrack.geometry.rotation import rotation_matrix
from handtrack_app.page.panels.pose import NUDGES, nudged
from handtrack_app.page.pins.grips import ROOT

VIEW = rotation_matrix(np.array([0.4, -1.1, 0.7]))
STEP_M, STEP_RAD = 0.003, 0.05


def applied(name, root, pivot):
    edit = nudged(root, NUDGES[name], VIEW, pivot, STEP_M, STEP_RAD)
    return np.array([edit[key] for key in ROOT])


@pytest.mark.parametrize(
    ("name", "way"),
    [("left", (-1, 0, 0)), ("right", (1, 0, 0)), ("up", (0, -1, 0)), ("down", (0, 1, 0)),
     ("nearer", (0, 0, -1)), ("farther", (0, 0, 1))],
)  # fmt: skip
def test_a_move_goes_along_the_view(name, way, rng):
    root = rng.normal(size=6)
    after = applied(name, root, rng.normal(size=3))
    np.testing.assert_allclose(VIEW.T @ (after[:3] - root[:3]), STEP_M * np.array(way), atol=1e-12)
    np.testing.assert_allclose(after[3:], root[3:], atol=1e-9)


@pytest.mark.parametrize("name", [name for name in NUDGES if any(NUDGES[name][3:])])
def test_a_turn_leaves_the_middle_and_its_opposite_undoes_it(name, rng):
    root, pivot = rng.normal(size=6), rng.normal(size=3)
    after = applied(name, root, pivot)
    inside = rotation_matrix(root[3:]).T @ (pivot - root[:3])  # the middle, as the hand carries it
    np.testing.assert_allclose(after[:3] + rotation_matrix(after[3:]) @ inside, pivot, atol=1e-9)
    opposite = next(n for n, nudge in NUDGES.items() if nudge[3:] == tuple(-v for v in NUDGES[name][3:]) and n != name)  # fmt: skip
    np.testing.assert_allclose(applied(opposite, after, pivot), root, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "axis", "sign"), [("tilt up", 1, -1), ("turn left", 0, -1), ("turn right", 0, 1)]
)
def test_the_side_that_faces_the_viewer_goes_where_the_name_says(name, axis, sign):
    edit = nudged(np.zeros(6), NUDGES[name], np.eye(3), np.zeros(3), STEP_M, STEP_RAD)
    front = rotation_matrix(np.array([edit[key] for key in ROOT[3:]])) @ (0.0, 0.0, -0.1)
    assert sign * front[axis] > 0.004
