"""The finite-difference check itself: it passes what is right and names what is wrong."""

from dataclasses import dataclass

import numpy as np
import pytest

from handtrack.model.kinematics import BonePoses
from handtrack.terms.rows import Rows, motion_row
from handtrack.terms.term import ObservationTerm
from tests.derivatives import (
    check_jacobian,
    check_observation_term,
    deformed,
)


@dataclass(frozen=True)
class PointTerm(ObservationTerm):
    """½|X − target|² of one point on the second bone."""

    target: np.ndarray
    slip: float = 0.0
    name: str = "point"

    def add_to(self, bones, sums):
        x = bones.to_world(np.array([1, 1, 1]), np.tile([0.1, 0.2, 0.3], (3, 1)))
        residual = x[0] - self.target
        motion = motion_row(x, np.eye(3), bones.reference, sums.width)
        motion[0, 3] += self.slip
        cost = 0.5 * float(residual @ residual)
        return Rows(residual, np.arange(3), np.ones(3, int), motion, cost, np.ones(3)).add_to(sums)


@pytest.fixture
def bones(rng) -> BonePoses:
    still = BonePoses(rng.normal(size=3), np.tile(np.eye(3), (2, 1, 1)), rng.normal(size=(2, 3)))
    return deformed(still, rng.normal(size=(2, 6)))


def test_a_wrong_term_is_named_with_both_numbers(bones, rng):
    term = PointTerm(rng.normal(size=3), slip=0.5)
    with pytest.raises(AssertionError, match=r"cost by index wx: derivative .*, differences "):
        check_observation_term(term, bones, ("palm", "index"))


def test_a_derivative_that_is_not_a_number_fails(rng):
    with pytest.raises(AssertionError, match="1 of 4 derivatives"):
        check_jacobian(lambda x: x, np.array([[1.0, 0.0], [np.nan, 1.0]]), rng.normal(size=2))
