"""Which chain is jumped: votes by hand, and what has no say."""

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.sampling.chain_vote import chain_votes
from handtrack.sampling.chains import chains_of


@pytest.fixture(scope="module")
def body():
    return load_model("body34")


def _spread(model, **std):
    variance = np.full(len(model.transform.names), 1e-12)
    for name, value in std.items():
        variance[model.transform.names.index(name)] = value**2
    return np.diag(variance)


def test_the_least_certain_chain_gets_nearly_all_votes(body):
    chains = chains_of(body)
    votes = chain_votes(
        body, body.rest_params(), _spread(body, right_elbow_flex=0.5, left_knee_flex=0.01), chains
    )
    assert chains[int(np.argmax(votes))].name == "right_arm"
    assert votes.sum() == pytest.approx(1.0)
    assert votes.max() > 0.99


def test_votes_are_shares_of_variance_in_units_of_the_limits(body):
    """Two directions: each chain's share is (σ / range)²."""
    chains = chains_of(body)
    votes = chain_votes(
        body, body.rest_params(), _spread(body, right_elbow_flex=0.3, left_knee_flex=0.3), chains
    )
    by_name = dict(zip([c.name for c in chains], votes, strict=True))
    width = {
        name: np.ptp(body.limits.interval[body.parameter_names.index(name)])
        for name in ("right_elbow_flex", "left_knee_flex")
    }
    expected = (width["left_knee_flex"] / width["right_elbow_flex"]) ** 2
    assert by_name["right_arm"] / by_name["left_leg"] == pytest.approx(expected)


def test_what_is_known_and_where_the_root_is_have_no_say(body):
    chains = chains_of(body)
    nothing = chain_votes(body, body.rest_params(), np.zeros((34, 34)), chains)
    np.testing.assert_allclose(nothing, 0.2)
    root = chain_votes(body, body.rest_params(), _spread(body, root_tz=3.0, neck_flex=0.1), chains)
    assert chains[int(np.argmax(root))].name == "neck"
    assert root.max() > 0.99
