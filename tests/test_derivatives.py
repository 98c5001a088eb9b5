"""The finite-difference check itself: it passes what is right and names what is wrong."""

import numpy as np
import pytest

from handtrack import JointPositionTerm, load_model
from tests.derivatives import check_jacobian, check_observation_term

HAND = load_model()


class SlippedTerm(JointPositionTerm):
    """One whose derivative by a turn of the first bone is wrong."""

    def add_to(self, bones, sums):
        cost = super().add_to(bones, sums)
        sums.gradient[3:4] += 0.5
        return cost


def test_a_wrong_term_is_named_with_both_numbers(rng):
    term = SlippedTerm(HAND, ("index_tip",), lambda at: at[0])
    bones = HAND.bones(HAND.clipped(rng.normal(scale=0.3, size=26)))
    with pytest.raises(AssertionError, match=r"cost by root wx: derivative .*, differences "):
        check_observation_term(term, bones, HAND.skeleton.bone_names)


def test_a_derivative_that_is_not_a_number_fails(rng):
    with pytest.raises(AssertionError, match="1 of 4 derivatives"):
        check_jacobian(lambda x: x, np.array([[1.0, 0.0], [np.nan, 1.0]]), rng.normal(size=2))
