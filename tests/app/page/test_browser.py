"""The workbench in a real browser. What a gesture edits: a click nothing, a drag one step that undo names, a key behind a dialog nothing.
A click on the lanes goes to the frame that stands there, also when zoomed in."""

import contextlib
import re
import threading

import numpy as np
import pytest
import viser.transforms as vtf

from handtrack_app.engine.store import persistence
from tests.app.desk import in_threads
from tests.app.fake_run import FRAMES, fake_document
from tests.app.page.test_review_panel import _tracked
from tests.app.waiting import eventually
from tests.experiments.workbench.chromium import CHROMIUM, DRAWN, PROJECT, chromium, there_is_one

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")


class PageUnderTest:
    """The few gestures that the test needs."""

    def __init__(self, page):
        self.page = page

    def row(self, label):
        exact = re.compile(rf"^{re.escape(label)}$")
        found = self.page.locator("label").filter(has_text=exact).first
        return found.locator("xpath=ancestor::div[contains(@class, 'mantine-Flex-root')][1]")

    def press(self, name):
        self.page.get_by_role("button", name=name, exact=True).click()

    def show_tab(self, name):
        if name in ("Export", "Settings", "Masks", "Cloud", "Messages"):
            self.page.get_by_role("tab", name="More", exact=True).click()
        self.page.get_by_role("tab", name=name, exact=True).click()

    def drag(self, start, stop, steps=8, rest_ms=60):
        """rest_ms: viser sends every 50 ms."""
        mouse = self.page.mouse
        mouse.move(*start)
        self.page.wait_for_timeout(600)  # the page looks what is under the pointer
        mouse.down()
        for i in range(1, steps + 1):
            mouse.move(*(a + i / steps * (b - a) for a, b in zip(start, stop, strict=True)))
            self.page.wait_for_timeout(rest_ms)
        mouse.up()


@contextlib.contextmanager
def browsing(bench, dpr=0.5, size=(1300, 800)):
    """Show a workbench in a real browser; it is stopped afterwards."""
    if not there_is_one():
        pytest.skip(f"no browser at {CHROMIUM}; set CHROMIUM")
    bench.start()
    assert bench.wait_ready()
    bench.server.scene.configure_environment_map(None)  # the slowest part to draw in software
    with chromium(size, "--webgl-antialiasing-mode=none") as (page, errors):
        page.goto(f"{bench.url}&fixedDpr={dpr:g}")
        page.wait_for_function(DRAWN, arg=["/hand/flesh", "/root"], timeout=60_000)
        eventually(
            bench.server.get_clients, "its camera is told: only then is it among the clients"
        )
        yield PageUnderTest(page)
        assert not errors, f"errors in the page: {errors}"
    bench.stop()


def stands(bench):
    """Return whether the first page stands in the camera that it looks through: it turns with the next frame that it draws."""
    client = next(iter(bench.server.get_clients().values()))
    view = bench.stage.looking.views.of(client.client_id)
    if view is None or abs(client.camera.fov - view.eye.fov) > 1e-6:
        return False
    turned = vtf.SO3(np.asarray(client.camera.wxyz, dtype=float)).as_matrix()
    return np.allclose(turned, view.eye.rotation, atol=1e-5)


HOLD_BACK = """() => {
  window.heldBack = 0;
  document.addEventListener("click", (event) => {
    if (event.target.textContent !== "☰") return;
    event.stopPropagation();
    window.heldBack += 1;
  }, true);
}"""
"""no click on the button of the lanes arrives: they are counted"""


@pytest.mark.browser
def test_what_a_gesture_edits(tmp_path, monkeypatch):
    monkeypatch.setattr(persistence, "_MERGE_S", 0.1)
    held = threading.Event()
    opener = lambda f: fake_document(f, stuck=lambda frame: frame == 8 and held.is_set())  # noqa: E731
    bench = in_threads(tmp_path, opener=opener)
    with browsing(bench) as view:
        _keys_behind_a_dialog_do_nothing_and_escape_closes_it(bench, view)
        _moves_of_a_slider_with_rests_are_one_step(bench, view)
        _a_click_on_the_handle_is_no_edit_and_a_drag_is_one_step(bench, view)
        _what_would_be_gripped_is_named_under_the_pointer(bench, view)
        _a_click_on_the_lanes_goes_there(bench, view)
        held.set()
        _tracking_is_cancelled(bench, view)


def _keys_behind_a_dialog_do_nothing_and_escape_closes_it(bench, view):
    before, keys = bench.state.values, view.page.keyboard
    dialog = view.page.get_by_role("dialog")

    def closes():
        keys.press("Escape")
        dialog.wait_for(state="detached")
        assert (bench.state.values, bench.state.version) == (before, 0)

    keys.press("Shift+H")
    dialog.wait_for()
    for key in ("k", "k", "Shift+K", "n"):
        keys.press(key)
    closes()
    keys.press("Control+k")  # the palette: what is typed before it takes the letters
    keys.type("track", delay=5)
    view.page.wait_for_timeout(1000)
    closes()
    keys.press("k")
    eventually(lambda: bench.state.version == 1, "keys count again")
    assert bench.state.values != before


def _what_would_be_gripped_is_named_under_the_pointer(bench, view):
    view.page.keyboard.press("1")
    eventually(lambda: stands(bench), "looked through a camera")
    places = dict(zip(bench.stage.session.joint_names, bench.stage.pose.joints, strict=True))

    def named_at(place):
        view.page.mouse.move(*view.page.evaluate(PROJECT, ["", place.tolist()]))
        view.page.wait_for_timeout(100)
        return view.page.locator("#handtrack-held").inner_text()

    for place, words in (
        (places["index_tip"], "index tip"),
        (0.5 * (places["index_mcp"] + places["index_pip"]), "index proximal"),
        (places["wrist"], "wrist"),
        (places["index_tip"] + [0.0, 0.04, 0.0], ""),
    ):
        eventually(lambda place=place, words=words: named_at(place) == words, words)


def _a_click_on_the_handle_is_no_edit_and_a_drag_is_one_step(bench, view):
    bench.page.edit_pose({"root_rx": 0.2, "root_ry": -0.4, "root_rz": 0.3}, "Turn")
    version = bench.state.version
    eventually(lambda: bench.stage.pose.version == version, "the hand stands askew")
    before, mouse, phases = bench.state.values, view.page.mouse, list[str]()
    bench.stage.root.control.on_update(lambda event: phases.append(event.phase))

    def on_the_arrow(gesture):
        for _ in range(4):  # a loaded machine may draw the arrow too late for the pointer
            centre, arrow = (
                np.array(view.page.evaluate(PROJECT, ["/root", p]))
                for p in ((0, 0, 0), (0, 0.08, 0))
            )
            gesture(arrow, arrow + 0.5 * (arrow - centre))
            if phases:
                break

    def click(at, _):
        mouse.move(*at)
        view.page.wait_for_timeout(800)
        mouse.down()
        view.page.wait_for_timeout(300)
        mouse.up()
        view.page.wait_for_timeout(500)

    on_the_arrow(click)
    eventually(lambda: {"start", "end"} <= {*phases}, "the click met the arrow")
    assert (bench.state.values, bench.state.version) == (before, version)
    phases.clear()
    on_the_arrow(lambda at, beyond: _drag_with_rests(view, at, beyond))
    eventually(lambda: "end" in phases, "all of the drag arrived")
    assert bench.state.version > version + 1, "several poses came of the drag"
    moved = np.abs(np.subtract(bench.state.values, before))
    assert moved[:3].max() > 0.005 and moved[3:].max() < 1e-3, "the arrow only moves"
    view.page.keyboard.press("Control+z")
    view.page.get_by_text("Undone: move, frame 3").first.wait_for()
    eventually(lambda: bench.state.values == before, "one step took all of it back")


def _moves_of_a_slider_with_rests_are_one_step(bench, view):
    view.press("Index")
    before, version = bench.state.values, bench.state.version
    box = view.row("PIP flex °").locator(".mantine-Slider-track").bounding_box()
    at = lambda share: (box["x"] + share * box["width"], box["y"] + box["height"] / 2)  # noqa: E731
    _drag_with_rests(view, at(0.3), at(0.8))
    eventually(lambda: bench.state.version > version + 1, "several poses came of the drag")
    eventually(lambda: bench.layout.pose.pose.version == bench.state.version, "all are shown")
    view.page.keyboard.press("Control+z")
    view.page.get_by_text("Undone: index PIP flex, frame 3").first.wait_for()
    eventually(lambda: bench.state.values == before, "one step took all of it back")


def _drag_with_rests(view, start, stop):
    view.drag(start, stop, 3, 300)  # longer than any pause between edits
    view.page.wait_for_timeout(200)


def _a_click_on_the_lanes_goes_there(bench, view):
    _tracked(bench)
    mouse, picture = view.page.mouse, view.page.locator(".handtrack-timeline svg")
    for frame in (8, 2, 11):
        box = eventually(picture.bounding_box, "the lanes are there")  # they are sent anew
        x = box["x"] + frame / (FRAMES - 1) * box["width"]
        mouse.click(x - 1, box["y"] + 20)  # within the curve
        eventually(lambda frame=frame: bench.state.frame == frame, f"frame {frame}")
    panel = view.page.locator(".mantine-Paper-root:has(.handtrack-timeline)")

    def drag_edge(*by):
        edge = panel.bounding_box()["y"] + 2
        mouse.move(400, edge)
        mouse.down()
        for down in by:
            mouse.move(400, edge + down)
        mouse.up()

    for way, every in ((-1, True), (1, False)):  # its upper edge is dragged up, and down again
        drag_edge(*(5 * way * n for n in range(1, 7)))
        shown = view.page.locator(".handtrack-every")
        eventually(lambda every=every, shown=shown: shown.count() == every, f"every: {every}")
    view.page.evaluate(HOLD_BACK)  # as where the program is slow
    drag_edge(-20, -40, -60)
    assert view.page.evaluate("window.heldBack") == 1
    view.page.keyboard.press("Shift+Z")
    eventually(lambda: bench.state.frame == 7, "the worst one, by key")
    view.page.keyboard.press("Shift+Y")
    eventually(lambda: bench.worker.document.accepted == {7}, "accepted, by key")
    view.press("Export …")  # the next step
    opened = view.page.get_by_role("tab", name="Export", exact=True, selected=True)
    eventually(opened.count, "its tab is opened")


def _tracking_is_cancelled(bench, view):
    view.show_tab("Track")
    view.press("Track all frames")
    cancel = view.page.get_by_role("button", name="Cancel", exact=True)
    eventually(lambda: bench.layout.tracking.progress.done >= 2, "two frames are done")
    cancel.click()
    # how soon it stops is asked of the worker alone (test_worker.py): beside other tests the page may be late
    eventually(lambda: bench.layout.tracking.progress.state == "idle", "cancelled")
    view.page.get_by_text("Cancelled").first.wait_for()
