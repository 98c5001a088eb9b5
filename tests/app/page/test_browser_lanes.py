"""The lanes in a real browser: a click on them goes to the frame that stands there, also when zoomed in."""

import pytest

from tests.app.desk import in_threads
from tests.app.fake_run import FRAMES, fake_document
from tests.app.page.test_browser import browsing
from tests.app.page.test_review_panel import _tracked
from tests.app.waiting import eventually

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
def test_a_click_on_the_lanes_goes_there(tmp_path):
    bench = in_threads(tmp_path, opener=fake_document)
    with browsing(bench) as view:
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
