"""Every command by key or palette: all that the work needs is there, no key twice, none that viser walks by; help and tour."""

from handtrack_app.page.help import TOUR
from tests.app.fake_run import FRAMES
from tests.app.page.test_room import said
from tests.app.waiting import eventually
from tests.app.wire import WireClient


def test_no_key_is_given_twice_or_to_viser(bench):
    commands = [
        handle._impl.props for handle in bench.server.gui._command_handle_from_uuid.values()
    ]
    keys = [(one.hotkey, one.modifier) for one in commands if one.hotkey is not None]
    assert len(keys) == len(set(keys)), sorted(k for k in keys if keys.count(k) > 1)
    walking = {"W", "A", "S", "D", "Q", "E"}
    assert not walking & {key for key, _ in keys}


def test_the_handle_moves_or_turns_along_one_axis_by_keys(bench, page):
    control = bench.stage.root.control

    def free():
        return not control.disable_axes, not control.disable_rotations, control.active_axes

    page.press("Grab: move the hand; then X, Y or Z")
    eventually(lambda: free() == (True, False, (True, True, True)), "it moves")
    page.press("View: wider")  # its key is X
    eventually(lambda: free() == (True, False, (True, False, False)), "along x")
    page.press("Turn the hand; then X, Y or Z")
    eventually(lambda: free() == (False, True, (True, True, True)), "it turns")
    page.press("View: wider")
    eventually(lambda: free() == (False, True, (False, True, True)), "about x")
    page.press("Close the dialog, or leave the camera")  # Escape
    eventually(lambda: free() == (True, True, (True, True, True)), "as it was")


def test_frames_and_keyframes_by_key(bench, page):
    page.press("First frame")
    eventually(lambda: bench.state.frame == 0, "the first")
    page.press("Ten frames on")
    eventually(lambda: bench.state.frame == 10, "ten on")
    page.press("Ten frames on")
    eventually(lambda: bench.state.frame == FRAMES - 1, "no farther than the last")
    page.press("Ten frames back")
    eventually(lambda: bench.state.frame == FRAMES - 11, "ten back")
    page.press("Keep this pose: a keyframe")
    strip = bench.layout.timeline
    eventually(lambda: strip.strip is not None and 1 in strip.strip.by_hand, "kept")
    page.press("No keyframe here: the tracked pose")
    eventually(lambda: strip.strip is not None and 1 not in strip.strip.by_hand, "not kept")


def test_who_comes_first_is_led_in_five_steps_and_can_leave_at_once(bench):
    bench.layout.help.offers_tour = True  # before anybody comes
    assert len(TOUR) == 5
    with WireClient(bench.url) as wire:
        questions = lambda: said(wire, "LocalStorageGetItemRequestMessage")  # noqa: E731
        eventually(lambda: len(questions()) == 2, "both questions to the browser's memory")
        for one in questions():
            wire.answer(one, None)
        eventually(lambda: wire.button("Tour") is not None, "it begins")
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
        eventually(lambda: wire.button("Tour") is None, "left")
        eventually(lambda: bool(said(wire, "LocalStorageSetItemMessage")), "and remembered")
