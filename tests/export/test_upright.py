"""A world turned so that it stands in a format whose readers take one axis for up."""

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack.export.registry import AXES
from handtrack.export.table import ResultsTable, axis, turn_between, upright
from tests.export.sequences import KINDS, sample_sequence


@pytest.mark.parametrize(("up", "wanted"), [*product(AXES, AXES)])
def test_the_axis_is_brought_to_the_other_by_a_turn(up, wanted):
    turn = turn_between(up, wanted)
    assert_allclose(turn @ axis(up), axis(wanted), atol=1e-15)
    assert_allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_turns_are_those_that_programs_use():
    """z up to y up as importers of Blender and ROS do, (x, y, z) to (x, z, -y); a camera's axes to a screen's."""
    point = np.array([1.0, 2.0, 3.0])
    assert (turn_between("z", "y") @ point).tolist() == [1.0, 3.0, -2.0]
    assert (turn_between("-y", "y") @ point).tolist() == [1.0, -2.0, -3.0]


@pytest.mark.parametrize("kind", KINDS)
def test_all_that_is_of_the_world_turns_together(kind):
    """The model posed by the turned parameters has its joints where the turned positions say."""
    track = sample_sequence(kind)[1]
    turned = upright(track, "-y", "z")
    assert ResultsTable(turned).misfit_m < 1e-9
    turn = turn_between("-y", "z")
    assert_allclose(turned.joint_positions, track.joint_positions @ turn.T)
    assert_allclose(turned.T_world_bone[..., :3, 3], track.T_world_bone[..., :3, 3] @ turn.T)  # fmt: skip
    assert_allclose(turned.parameters[:, 6:], track.parameters[:, 6:])
    assert turned.cameras is None
