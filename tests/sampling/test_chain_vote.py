"""Which chain is jumped: votes by hand, and what has no say."""

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.sampling.chains import chain_votes, chains_of


@pytest.fixture(scope="module")
def body():
    return load_model("body34")


def _spread(model, **std):
    variance = np.full(len(model.transform.names), 1e-12)
    for name, value in std.items():
        variance[model.transform.names.index(name)] = value**2
    return np.diag(variance)


def test_what_is_known_and_where_the_root_is_have_no_say(body):
    chains = chains_of(body)
    nothing = chain_votes(body, body.rest_params(), np.zeros((34, 34)), chains)
    np.testing.assert_allclose(nothing, 0.2)
    root = chain_votes(body, body.rest_params(), _spread(body, root_tz=3.0, neck_flex=0.1), chains)
    assert chains[int(np.argmax(root))].name == "neck"
    assert root.max() > 0.99


def _along(model, **direction):
    """Return (P,) a unit direction among parameters in units of their ranges, and those ranges (inf where there is none)."""
    low, high = model.bounds(model.rest_params()).T
    unit = np.zeros(len(low))
    for name, share in direction.items():
        unit[model.transform.names.index(name)] = share
    return unit / np.linalg.norm(unit), np.where(np.isfinite(high - low), high - low, 1.0)


def _votes(model, *bells):
    """Return votes by chain for a covariance of bells along unit directions: (variance, direction by name) each."""
    whole = np.zeros((len(model.transform.names),) * 2)
    for variance, direction in bells:
        unit, width = _along(model, **direction)
        whole += variance * np.outer(unit * width, unit * width)
    chains = chains_of(model)
    votes = chain_votes(model, model.rest_params(), whole, chains)
    return {chain.name: vote for chain, vote in zip(chains, votes, strict=True)}


def test_what_errs_together_votes_by_the_squares_of_its_shares(body):
    """One direction, 3 parts elbow and 4 parts knee, that are wrong together: 9 votes to 16."""
    together = _votes(body, (1e-2, {"right_elbow_flex": 3.0, "left_knee_flex": -4.0}))
    assert together["right_arm"] == pytest.approx(9.0 / 25.0)
    assert together["left_leg"] == pytest.approx(16.0 / 25.0)


@pytest.mark.parametrize(("small", "has_say"), [(0.04, False), (0.06, True)])
def test_directions_vote_until_they_make_up_95_percent_of_the_variance(body, small, has_say):
    votes = _votes(
        body,
        (1.0 - small, {"right_elbow_flex": 1.0, "left_elbow_flex": 1.0}),
        (small, {"left_knee_flex": 2.0, "neck_flex": 1.0}),
    )
    assert votes["right_arm"] == pytest.approx(0.5 * (1.0 - small * has_say))
    assert votes["left_leg"] == pytest.approx(0.8 * small * has_say)
    assert votes["neck"] == pytest.approx(0.2 * small * has_say)
    assert votes["right_leg"] == pytest.approx(0.0, abs=1e-9)


def test_where_no_chain_has_a_say_all_are_alike(body):
    assert set(_votes(body, (1.0, {"root_tz": 1.0})).values()) == {0.2}
    assert set(_votes(body, (1.0, {"spine_flex": 1.0})).values()) == {0.2}
