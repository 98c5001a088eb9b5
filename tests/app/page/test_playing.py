"""While a recording plays, no more frames come than the page draws, and none where nobody looks or somebody edits; values that no widget should send."""

import time
from types import SimpleNamespace

import pytest

from handtrack_app.page.page import UserState
from handtrack_app.page.timeline import Player
from tests.app.waiting import eventually
from tests.app.wire import WireClient


@pytest.fixture
def asked(bench):
    """The frames that the engine is asked for."""
    frames, send = list[int](), bench.worker.send

    def sent(call):
        if call.name == "show_frame":
            frames.append(call.arguments["frame"])
        send(call)

    bench.worker.send = sent
    return frames


def test_no_more_than_two_frames_are_on_their_way(bench, asked):
    with WireClient(bench.url, draws=False) as wire:
        eventually(bench.server.get_clients)
        bench.page.play(True)
        eventually(lambda: len(asked) == 2, "it draws none of them")
        time.sleep(0.3)
        answered = 0  # a frame that is told again is asked about again
        while len(asked) == 2:
            eventually(lambda: len(asked) > 2 or len(_questions(wire)) > answered)  # noqa: B023
            for question in _questions(wire)[answered:]:
                wire.answer(question, None)
                answered += 1
            time.sleep(0.3)
        assert len(asked) == 3 and answered >= 2, "it takes the frame, and has drawn it"


def test_nothing_is_played_while_no_page_is_open(bench, asked):
    """The demo plays by itself, and its page may be closed, or never be opened: the program rests then."""
    bench.page.play(True)
    time.sleep(0.5)
    assert not asked, "nobody sees it"
    with WireClient(bench.url):
        eventually(lambda: len(asked) > 2, "it plays to who comes")
    eventually(lambda: not bench.server.get_clients())

    def rests():  # what was asked for before may still be under way
        asked.clear()
        time.sleep(0.5)
        return not asked

    eventually(rests, "nobody sees it any more")


def _questions(wire):
    return [message for _, message in wire.messages if message.get("key") == "handtrack.drawn"]


def test_no_frame_is_played_over_who_edits():
    """The frame asked for next is not the one whose pose is edited; and none comes after."""
    state = UserState(values=(0.5,), values_at=7, frame=8, playing=True)
    state.session = SimpleNamespace(parameter_names=("a",))  # type: ignore[assignment]
    state.strip = SimpleNamespace(start=0, stop=99)  # type: ignore[assignment]
    asked, ended = list[float](), list[bool]()
    drawn = SimpleNamespace(is_watched=True, has_room=True, clear=lambda: None)
    player = Player(state, asked.append, drawn, lambda: ended.append(True))  # type: ignore[arg-type]
    player.start()
    try:
        eventually(lambda: asked)
        edit = state.edit({"a": 0.7})
        assert edit is not None and edit[0] == 7
        asked.clear()
        eventually(lambda: ended)
        assert not asked and state.frame == 7 and not state.playing
    finally:
        player.stop()
