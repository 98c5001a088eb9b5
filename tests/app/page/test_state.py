"""The user's state: edits, undo, and values that no widget should send."""

from __future__ import annotations

import math

import pytest

from handtrack_app.page.state import PoseStep, UndoStack, UserState


def _state() -> UserState:
    return UserState(names=("a", "b"), values=(0.0, 1.0), start=0, stop=10)


def test_an_edit_changes_one_value_and_can_be_undone_and_redone() -> None:
    state = _state()
    edit = state.edit({"a": 0.5}, "slider a")
    assert edit == PoseStep(0, (0.5, 1.0))
    assert state.travel(back=True) == PoseStep(0, (0.0, 1.0))
    assert state.travel(back=True) is None
    assert state.travel(back=False) == PoseStep(0, (0.5, 1.0))
    assert state.travel(back=False) is None


def test_every_step_through_history_is_a_new_version() -> None:
    state = _state()
    state.edit({"a": 0.5}, "slider a")
    before = state.version
    state.travel(back=True)
    assert state.version == before + 1


def test_a_drag_is_one_step() -> None:
    stack = UndoStack()
    for k in range(20):
        stack.record(PoseStep(0, (float(k),)), "slider a", now=10 + 0.05 * k)
    assert stack.past == [PoseStep(0, (0.0,))]
    stack.record(PoseStep(0, (20.0,)), "slider b", now=11.0)
    stack.record(PoseStep(0, (21.0,)), "slider b", now=15.0)
    assert len(stack.past) == 3


def test_a_new_edit_drops_what_was_undone() -> None:
    state = _state()
    state.edit({"a": 0.5}, "slider a")
    state.travel(back=True)
    state.edit({"b": 2.0}, "slider b")
    assert state.travel(back=False) is None


def test_history_is_bounded() -> None:
    stack = UndoStack(depth=5)
    for k in range(20):
        stack.record(PoseStep(k, ()), f"tag {k}", now=float(k))
    assert [step.frame for step in stack.past] == [15, 16, 17, 18, 19]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_no_numbers_change_nothing(value: float) -> None:
    state = _state()
    assert state.edit({"a": value}, "slider a") is None
    assert state.values == (0.0, 1.0)
    assert not state.undo.past


def test_unknown_parameters_and_equal_values_change_nothing() -> None:
    state = _state()
    assert state.edit({"c": 1.0}, "x") is None
    assert state.edit({"b": 1.0}, "x") is None
    assert state.version == 0


@pytest.mark.parametrize(
    ("given", "frame"), [(3.4, 3), (-5, 0), (1e9, 9), (math.nan, None), (math.inf, None)]
)
def test_frames_from_clients_stay_inside_the_session(given: float, frame: int | None) -> None:
    assert _state().clamp_frame(given) == frame
