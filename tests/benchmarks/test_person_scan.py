"""The hands and recordings of `handtrack bench person_scan`."""

from __future__ import annotations

import numpy as np
import pytest

from handtrack.model.articulated import HandScale
from handtrack.model.size import shape_numbers
from tests.experiments.honesty.person_scan import drawn, moved, recorded


def test_a_hand_is_drawn_from_adults(rng):
    rows = shape_numbers(drawn(rng))
    assert np.std([row.value / row.sigma for row in rows]) == pytest.approx(1.0, abs=0.5)


def test_a_scan_turns_and_bends_and_is_tracked_as_the_mean_hand(rng, tmp_path):
    truth = drawn(rng)
    joint = moved(truth, ("open", "fist", "open"), 30, 1.0)
    index = truth.parameter_names.index("middle_pip_flex")
    assert np.ptp(joint[:, 4]) > 1.9
    assert np.ptp(joint[:, index]) > 1.0
    run = recorded(tmp_path / "scan", truth, "fist", 0)
    assert run.scale == HandScale()
    assert run.session.truth is not None
