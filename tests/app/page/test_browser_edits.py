"""What a gesture edits in a real browser: a click nothing, a drag one step that undo names, a key behind a dialog nothing.
A click on the lanes goes to the frame that stands there, also when zoomed in."""

import pytest

from handtrack_app.engine.store import persistence
from handtrack_app.workbench import Workbench
from tests.app.desk import in_threads
from tests.app.fake_run import FRAMES, fake_document
from tests.app.page.test_browser import PageUnderTest, browsing, stands
from tests.app.page.test_review_panel import _tracked
from tests.app.waiting import eventually
from tests.experiments.workbench.chromium import PROJECT

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

HOLD_BACK = """() => {
  window.heldBack = 0;
  document.addEventListener("click", (event) => {
    if (event.target.textContent !== "☰") return;
    event.stopPropagation();
    window.heldBack += 1;
  }, true);
}"""
"""no click on the button of the lanes arrives: they are counted"""


@pytest.fixture
def opened(tmp_path, monkeypatch):
    monkeypatch.setattr(persistence, "_MERGE_S", 0.1)
    bench = in_threads(tmp_path, opener=fake_document)
    with browsing(bench) as view:
        yield bench, view


def _arrow(view: PageUnderTest) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return where the arrow's middle is, and a place beyond its tip."""
    centre, arrow = (view.page.evaluate(PROJECT, ["/root", p]) for p in ((0, 0, 0), (0, 0.08, 0)))
    along = [b - a for a, b in zip(centre, arrow, strict=True)]
    return tuple(arrow), (arrow[0] + 0.5 * along[0], arrow[1] + 0.5 * along[1])


@pytest.mark.browser
def test_what_a_gesture_edits(opened):
    _keys_behind_a_dialog_do_nothing_and_escape_closes_it(*opened)
    _moves_of_a_slider_with_rests_are_one_step(*opened)
    _a_click_on_the_handle_is_no_edit_and_a_drag_is_one_step(*opened)
    _what_would_be_gripped_is_named_under_the_pointer(*opened)
    _a_click_on_the_lanes_goes_there(*opened)


def _keys_behind_a_dialog_do_nothing_and_escape_closes_it(
    bench: Workbench, view: PageUnderTest
) -> None:
    before, keys = bench.state.values, view.page.keyboard
    dialog = view.page.get_by_role("dialog")
    keys.press("Shift+H")
    dialog.wait_for()
    for key in ("k", "k", "Shift+K", "n"):
        keys.press(key)
    keys.press("Escape")
    dialog.wait_for(state="detached")
    assert (bench.state.values, bench.state.version) == (before, 0)
    keys.press("Control+k")  # the palette: what is typed before it takes the letters
    keys.type("track", delay=5)
    view.page.wait_for_timeout(1000)
    keys.press("Escape")
    dialog.wait_for(state="detached")
    assert (bench.state.values, bench.state.version) == (before, 0)
    keys.press("k")
    eventually(lambda: bench.state.version == 1, "keys count again")
    assert bench.state.values != before


def _what_would_be_gripped_is_named_under_the_pointer(
    bench: Workbench, view: PageUnderTest
) -> None:
    view.page.keyboard.press("1")
    eventually(lambda: stands(bench), "looked through a camera")
    session, pose = bench.stage.session, bench.stage.pose
    places = dict(zip(session.joint_names, pose.joints, strict=True))
    knuckle, middle = places["index_mcp"], places["index_pip"]
    for place, words in (
        (places["index_tip"], "index tip"),
        (0.5 * (knuckle + middle), "index proximal"),
        (places["wrist"], "wrist"),
        (places["index_tip"] + [0.0, 0.04, 0.0], ""),
    ):
        x, y = view.page.evaluate(PROJECT, ["", place.tolist()])
        eventually(lambda x=x, y=y, words=words: _named_at(view, x, y) == words, words)


def _named_at(view: PageUnderTest, x: float, y: float) -> str:
    view.page.mouse.move(x, y)
    view.page.wait_for_timeout(100)
    return view.page.locator("#handtrack-held").inner_text()


def _a_click_on_the_handle_is_no_edit_and_a_drag_is_one_step(
    bench: Workbench, view: PageUnderTest
) -> None:
    bench.page.edit_pose({"root_rx": 0.2, "root_ry": -0.4, "root_rz": 0.3}, "Turn")
    version = bench.state.version
    eventually(lambda: bench.stage.pose.version == version, "the hand stands askew")
    before, mouse, phases = bench.state.values, view.page.mouse, list[str]()
    bench.stage.root.control.on_update(lambda event: phases.append(event.phase))
    for _ in range(4):  # a loaded machine may draw the arrow too late for the pointer
        on, beyond = _arrow(view)
        mouse.move(*on)
        view.page.wait_for_timeout(800)
        mouse.down()
        view.page.wait_for_timeout(300)
        mouse.up()
        view.page.wait_for_timeout(500)
        if phases:
            break
    eventually(lambda: {"start", "end"} <= {*phases}, "the click met the arrow")
    assert (bench.state.values, bench.state.version) == (before, version)
    for _ in range(4):
        phases.clear()
        on, beyond = _arrow(view)
        _drag_with_rests(view, on, beyond)
        if phases:
            break
    eventually(lambda: "end" in phases, "all of the drag arrived")
    assert bench.state.version > version + 1, "several poses came of the drag"
    view.page.keyboard.press("Control+z")
    view.page.get_by_text("Undone: move, frame 3").first.wait_for()
    eventually(lambda: bench.state.values == before, "one step took all of it back")


def _moves_of_a_slider_with_rests_are_one_step(bench: Workbench, view: PageUnderTest) -> None:
    view.press("Index")
    before, version = bench.state.values, bench.state.version
    box = view.row("PIP flex °").locator(".mantine-Slider-track").bounding_box()
    middle = box["y"] + box["height"] / 2
    at = lambda share: (box["x"] + share * box["width"], middle)  # noqa: E731
    _drag_with_rests(view, at(0.3), at(0.8))
    eventually(lambda: bench.state.version > version + 1, "several poses came of the drag")
    eventually(lambda: bench.layout.pose.pose.version == bench.state.version, "all are shown")
    view.page.keyboard.press("Control+z")
    view.page.get_by_text("Undone: index PIP flex, frame 3").first.wait_for()
    eventually(lambda: bench.state.values == before, "one step took all of it back")


def _drag_with_rests(
    view: PageUnderTest, start: tuple[float, float], stop: tuple[float, float]
) -> None:
    mouse = view.page.mouse
    mouse.move(*start)
    view.page.wait_for_timeout(600)
    mouse.down()
    for i in range(1, 4):
        mouse.move(*(a + i / 3 * (b - a) for a, b in zip(start, stop, strict=True)), steps=3)
        view.page.wait_for_timeout(300)  # longer than any pause between edits
    mouse.up()
    view.page.wait_for_timeout(200)


def _a_click_on_the_lanes_goes_there(bench: Workbench, view: PageUnderTest) -> None:
    _tracked(bench)
    picture = view.page.locator(".handtrack-timeline svg")
    for frame in (8, 2, 11):
        box = eventually(picture.bounding_box, "the lanes are there")  # they are sent anew
        x = box["x"] + frame / (FRAMES - 1) * box["width"]
        view.page.mouse.click(x - 1, box["y"] + 20)  # within the curve
        eventually(lambda frame=frame: bench.state.frame == frame, f"frame {frame}")
    panel = view.page.locator(".mantine-Paper-root:has(.handtrack-timeline)")
    for way, every in ((-1, True), (1, False)):  # its upper edge is dragged up, and down again
        edge = panel.bounding_box()["y"] + 2
        view.page.mouse.move(400, edge)
        view.page.mouse.down()
        view.page.mouse.move(400, edge + 30 * way, steps=6)
        view.page.mouse.up()
        shown = view.page.locator(".handtrack-every")
        eventually(lambda every=every, shown=shown: shown.count() == every, f"every: {every}")
    view.page.evaluate(HOLD_BACK)  # as where the program is slow
    edge = panel.bounding_box()["y"] + 2
    view.page.mouse.move(400, edge)
    view.page.mouse.down()
    for step in (20, 40, 60):
        view.page.mouse.move(400, edge - step)
    view.page.mouse.up()
    assert view.page.evaluate("window.heldBack") == 1
    view.page.keyboard.press("Shift+Z")
    eventually(lambda: bench.state.frame == 7, "the worst one, by key")
    view.page.keyboard.press("Shift+Y")
    eventually(lambda: bench.worker.document.accepted == {7}, "accepted, by key")
    view.press("Export …")  # the next step
    opened = view.page.get_by_role("tab", name="Export", exact=True, selected=True)
    eventually(opened.count, "its tab is opened")
