"""History: whoever takes the same actions has the same state, and undo goes back as it came."""

import tracemalloc
from typing import Any

from handtrack.store.history import Action, Change, History


def do(history: History, key: str, after: Any, kind: str = "do", joins: bool = False) -> Action:
    change = Change(key, history.state.get(key), after)
    action = history.next(f"{key} to {after}", [change], kind, joins)
    history.take(action)
    return action


def travel(history: History, action: Action | None) -> str:
    assert action is not None
    history.take(action)
    return action.words


def test_what_is_read_again_is_the_same():
    history = History()
    actions = [do(history, "a", 1), do(history, "b", [2]), do(history, "a", None)]
    undo = history.undoing()
    travel(history, undo)
    assert history.state == {"a": 1, "b": [2]}
    again = History.of(Action.of(action.content) for action in (*actions, undo) if action)
    assert again == history


def test_undo_and_redo_go_along_the_steps():
    history = History()
    for value in (1, 2, 3):
        do(history, "a", value)
    assert travel(history, history.undoing()) == "a to 3"
    assert travel(history, history.undoing()) == "a to 2"
    assert history.state == {"a": 1}
    assert travel(history, history.redoing()) == "a to 2"
    do(history, "b", 1)
    assert history.redoing() is None, "a new step drops what was undone"
    for _ in range(3):
        travel(history, history.undoing())
    assert history.undoing() is None and history.state == {}


def test_a_drag_is_one_step_back_to_where_it_began():
    history = History()
    do(history, "a", 1)
    for value in (2, 3, 4):
        do(history, "a", value, joins=value > 2)
    travel(history, history.undoing())
    assert history.state == {"a": 1}
    travel(history, history.redoing())
    assert history.state == {"a": 4}


def test_history_has_no_end():
    history = History()
    for value in range(1, 2001):
        do(history, "a", value)
    for value in range(2000, 0, -1):
        assert history.state == {"a": value}
        travel(history, history.undoing())
    assert history.state == {} and len(history.future) == 2000
    for value in range(1, 2001):
        travel(history, history.redoing())
        assert history.state == {"a": value}


def test_c60_a_long_history_is_small():
    pose, history = [0.1 * i for i in range(26)], History()
    tracemalloc.start()
    for shift in range(1000):
        do(history, "pose/3", [value + shift for value in pose])
    rescaled = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert rescaled < 1.2e6, "about 1 kB a pose, written out 3"
