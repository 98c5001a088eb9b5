"""The user's state: edits, and values that no widget should send."""

from __future__ import annotations

import math

import pytest

from handtrack_app.page.state import PoseEdit, UserState


def _state() -> UserState:
    return UserState(names=("a", "b"), values=(0.0, 1.0), start=0, stop=10)


def test_an_edit_changes_one_value_and_is_a_new_version() -> None:
    state = _state()
    assert state.edit({"a": 0.5}) == PoseEdit(0, (0.5, 1.0), 1)
    assert state.edit({"b": 2.0}) == PoseEdit(0, (0.5, 2.0), 2)
    assert (state.values, state.version, state.follow) == ((0.5, 2.0), 2, False)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_no_numbers_change_nothing(value: float) -> None:
    state = _state()
    assert state.edit({"a": value}) is None
    assert state.values == (0.0, 1.0)


def test_unknown_parameters_and_equal_values_change_nothing() -> None:
    state = _state()
    assert state.edit({"c": 1.0}) is None
    assert state.edit({"b": 1.0}) is None
    assert state.version == 0


@pytest.mark.parametrize(
    ("given", "frame"), [(3.4, 3), (-5, 0), (1e9, 9), (math.nan, None), (math.inf, None)]
)
def test_frames_from_clients_stay_inside_the_session(given: float, frame: int | None) -> None:
    assert _state().clamp_frame(given) == frame
