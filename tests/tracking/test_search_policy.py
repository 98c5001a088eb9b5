"""Rounds of a search: propose, thin, fit; a pose is taken only if it is better by the row's gain."""

from types import SimpleNamespace

import numpy as np

from handtrack import load_model
from handtrack.tracking.frame.control import Control
from handtrack.tracking.search.engine import (
    Candidate,
    Round,
    Search,
    improved,
    run_rounds,
)

MODEL = load_model()


def candidate(x):
    return Candidate(MODEL, np.array([x]), abs(x - 3.0))


def grid(line, found, most):
    return [candidate(x) for x in (0.0, 1.0, 2.5, 2.6)]


def half(line, candidates, iterations):
    for _ in range(iterations):
        candidates = [candidate(0.5 * (c.params[0] + 3.0)) for c in candidates]
    return candidates


def line(on_search=None):
    """Return an objective in one number: the cost is its distance from 3, a fit halves the way there."""
    return SimpleNamespace(
        control=Control(on_search=on_search),
        distinct=lambda found, most: sorted(found, key=lambda c: c.cost)[:most],
    )


def places(found):
    return [c.params[0] for c in found]


def test_a_round_proposes_thins_and_fits():
    search = Search("", "", (Round(((grid, 0),), enter=2, fits=((half, 1),)),), "")
    assert places(run_rounds(search, line(), ())) == [2.8, 2.75]
    alone = Search("", "", (Round(((grid, 0),), keep=0, fits=((half, 1),)),), "")
    assert places(run_rounds(alone, line(), [candidate(5.0)])) == [1.5, 2.0, 2.75, 2.8]
    adds = Search("", "", (Round(((grid, 0),), adds=True, enter=1, fits=((half, 2),)),), "")
    assert places(run_rounds(adds, line(), [candidate(5.0)])) == [5.0, 2.9]


def test_a_pose_is_taken_only_where_it_is_better_by_the_rows_gain():
    rounds = (Round(((grid, 0),), keep=0),)
    for factor, margin, start, taken in (
        (1.0, 0.0, 3.41, True), (1.0, 0.0, 3.39, False), (1.0, 1.0, 4.3, False), (1.0, 1.0, 4.5, True),
        (0.5, 0.0, 3.7, False), (0.5, 0.0, 3.9, True),
    ):  # fmt: skip
        search = Search("", "", rounds, "", factor=factor, margin=margin)
        standing, told = candidate(start), []
        found = improved(search, line(told.append), standing, 7, "asked")
        assert (found is not standing) == taken, (factor, margin, start)
        assert (told[0].winner is not None) == taken
        assert places([found]) == ([2.6] if taken else [start])


def test_it_goes_on_from_a_better_pose_as_often_as_the_row_says():
    rounds = (Round(((grid, 0),), keep=0, fits=((half, 1),)),)
    told = []
    search = Search("a line", "", rounds, "distance", repeats=3)
    improved(search, line(told.append), candidate(9.0), 7, "asked")
    assert [report.winner is not None for report in told] == [True, False]
