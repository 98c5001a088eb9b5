"""The user's state: edits, and values that no widget should send."""

import math
from types import SimpleNamespace

import pytest

from handtrack_app.page.page import UserState
from handtrack_app.page.player import Player
from tests.app.waiting import eventually


def _state():
    return UserState(names=("a", "b"), values=(0.0, 1.0), start=0, stop=10)


def test_an_edit_changes_one_value_and_is_a_new_version():
    state = _state()
    assert state.edit({"a": 0.5}) == (0, (0.5, 1.0), 1)
    assert state.edit({"b": 2.0}) == (0, (0.5, 2.0), 2)
    assert (state.values, state.version, state.follow) == ((0.5, 2.0), 2, False)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_no_numbers_change_nothing(value):
    state = _state()
    assert state.edit({"a": value}) is None
    assert state.values == (0.0, 1.0)


@pytest.mark.parametrize(
    ("given", "frame"), [(3.4, 3), (-5, 0), (1e9, 9), (math.nan, None), (math.inf, None)]
)
def test_frames_from_clients_stay_inside_the_session(given, frame):
    assert _state().clamp_frame(given) == frame


def test_no_frame_is_played_over_who_edits():
    """The frame asked for next is not the one whose pose is edited; and none comes after."""
    state = UserState(
        names=("a",), values=(0.5,), values_at=7, frame=8, start=0, stop=99, playing=True
    )
    asked, ended = list[float](), list[bool]()
    drawn = SimpleNamespace(is_watched=True, has_room=True, clear=lambda: None)
    player = Player(state, asked.append, drawn, lambda: ended.append(True))  # type: ignore[arg-type]
    player.start()
    try:
        eventually(lambda: bool(asked), "it plays")
        edit = state.edit({"a": 0.7})
        assert edit is not None and edit[0] == 7
        asked.clear()
        eventually(lambda: bool(ended), "told")
        assert not asked and state.frame == 7 and not state.playing
    finally:
        player.stop()
