"""A page's own room: folded panels, colours and text are its own, and its browser remembers them; commands by key, and the tour."""

import json

import pytest

from handtrack_app.page.panels.view import LIGHT, Taste, read_taste
from tests.app.fake_run import FRAMES
from tests.app.waiting import eventually
from tests.app.wire import Browser, WireClient, said


def answer(wire, kept):
    """Answer what the browser remembers."""
    eventually(lambda: said(wire, "LocalStorageGetItemRequestMessage"))
    wire.answer(said(wire, "LocalStorageGetItemRequestMessage")[-1], kept)


def folds(bench, wire):
    uuid = bench.page.gui.main_panel._placement_uuid
    told = said(wire, "GuiSetPanelCollapsedMessage")  # the first one is viser's own
    return [m["collapsed"] for m in told if m["uuid"] == uuid and m["counter"] > 1]


def test_a_page_gets_what_its_browser_remembers(bench, wire):
    answer(wire, json.dumps({"folded": True, "colours": LIGHT}))
    eventually(lambda: folds(bench, wire) == [True])
    eventually(lambda: said(wire, "ThemeConfigurationMessage")[-1]["dark_mode"] is False)


def test_keys_fold_and_the_browser_is_told_and_other_pages_keep_theirs(bench, pages):
    one, other = pages
    answer(one, None)
    answer(other, None)
    page = Browser(bench, one)
    page.press("Hide or show the panel")
    eventually(lambda: folds(bench, one) == [True])
    page.press("Light or dark")

    def kept():  # the newest: those that wait to be sent are merged
        return [read_taste(k["value"]) for k in said(one, "LocalStorageSetItemMessage")[-1:]]

    eventually(lambda: kept() == [Taste(True, LIGHT)])
    page.press("Hide or show the panel")
    eventually(lambda: folds(bench, one) == [True, False])
    assert folds(bench, other) == []
    assert all(m["dark_mode"] for m in said(other, "ThemeConfigurationMessage"))


@pytest.mark.parametrize("kept", [None, "", "{", "[]", "7", '{"folded": 3}', '{"folded": true}'])
def test_what_is_none_of_ours_is_forgotten(kept):
    assert read_taste(kept) is None


def test_no_key_is_given_twice_or_to_viser(bench):
    commands = [
        handle._impl.props for handle in bench.server.gui._command_handle_from_uuid.values()
    ]
    keys = [(one.hotkey, one.modifier) for one in commands if one.hotkey is not None]
    assert len(keys) == len(set(keys))
    assert not set("WASDQE") & {key for key, _ in keys}, "viser walks by them"


def test_the_handle_moves_or_turns_along_one_axis_by_keys(bench, page):
    control = bench.stage.root.control

    def free():
        return [not control.disable_axes, not control.disable_rotations, control.active_axes]

    x, escape = "View: wider", "Close the dialog, or leave the camera"  # what these keys else do
    for command, *wanted in (
        ("Grab: move the hand; then X, Y or Z", True, False, (True, True, True)),
        (x, True, False, (True, False, False)),
        ("Turn the hand; then X, Y or Z", False, True, (True, True, True)),
        (x, False, True, (False, True, True)),
        (escape, True, True, (True, True, True)),
    ):
        page.press(command)
        eventually(lambda wanted=wanted: free() == wanted, f"{wanted} after: {command}")


def test_frames_and_keyframes_by_key(bench, page):
    last, on, back = FRAMES - 1, "Ten frames on", "Ten frames back"
    for command, frame in (("First frame", 0), (on, 10), (on, last), (back, last - 10)):
        page.press(command)
        eventually(lambda frame=frame: bench.state.frame == frame, f"{frame} after: {command}")
    page.press("Set keyframe: this pose")
    eventually(lambda: 1 in bench.state.strip.by_hand)
    page.press("Remove keyframe: the tracked pose again")
    eventually(lambda: 1 not in bench.state.strip.by_hand)


def test_who_comes_first_is_led_in_five_steps_and_can_leave_at_once(bench):
    bench.layout.help.offers_tour = True  # before anybody comes
    with WireClient(bench.url) as wire:
        questions = lambda: said(wire, "LocalStorageGetItemRequestMessage")  # noqa: E731
        eventually(lambda: len(questions()) == 2)
        for one in questions():
            wire.answer(one, None)
        eventually(lambda: wire.button("Tour"))
        slider = bench.layout.pose.sliders["index_mcp_flex"]
        first = wire.button("Tour")
        wire.set_value(slider, 30.0)
        later = lambda before: eventually(  # noqa: E731
            lambda: (now := wire.button("Tour")) != before and now, "the next thing"
        )
        here = later(first)
        for _ in range(2):
            wire.set_value(here, "Skip")
            here = later(here)
        wire.set_value(here, "Leave")
        eventually(lambda: wire.button("Tour") is None)
        eventually(lambda: said(wire, "LocalStorageSetItemMessage"))
