"""The workbench in a real browser, opened once: how large scene and hand are; what a gesture edits, and undo names; all of one frame while
it plays; the lanes; what is said to the user; where model and picture are drawn; and a narrow window."""

import contextlib
import re

import cv2
import numpy as np
import pytest
import viser.transforms as vtf

from handtrack.export.registry import export_format
from handtrack_app.engine import persistence
from handtrack_app.page.panels.export import card_words
from handtrack_app.page.panels.view import WIDTH
from handtrack_app.page.scene.model_view import hand_balls
from handtrack_app.page.scene.viewpoint import Zoom, fov_of
from tests.app.desk import in_threads
from tests.app.fake_run import FRAMES, SPOT, fake_document
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

    def drag(self, start, stop, steps=8, came=lambda: True, rest_ms=60):
        """came: whether a move came to the program; rest_ms: after it, viser sends every 50 ms."""
        mouse = self.page.mouse
        mouse.move(*start)
        self.page.wait_for_timeout(600)  # the page looks what is under the pointer
        mouse.down()
        for i in range(1, steps + 1):
            mouse.move(*(a + i / steps * (b - a) for a, b in zip(start, stop, strict=True)))
            eventually(came)
            self.page.wait_for_timeout(rest_ms)
        mouse.up()


@contextlib.contextmanager
def browsing(bench):
    """Show a workbench in a real browser; it is stopped afterwards."""
    if not there_is_one():
        pytest.skip(f"no browser at {CHROMIUM}; set CHROMIUM")
    bench.start()
    assert bench.wait_ready(600.0)
    bench.server.scene.configure_environment_map(None)  # the slowest part to draw in software
    flags = "--webgl-antialiasing-mode=none", "--disable-gpu-compositing"
    with chromium((1280, 800), *flags) as (page, errors):
        page.add_init_script(FOUR_PER_SECOND)
        page.goto(f"{bench.url}&fixedDpr=0.25")
        page.wait_for_function(DRAWN, arg=["/hand/flesh", "/root"])
        eventually(
            bench.server.get_clients, "its camera is told: only then is it among the clients"
        )
        yield PageUnderTest(page)
        assert not errors, f"errors in the page: {errors}"
    bench.stop()


FOUR_PER_SECOND = """window.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 250);
window.cancelAnimationFrame = clearTimeout;"""
"""frames: each is drawn in software, a tenth of a second's work"""


def stands(bench):
    """Return whether the first page stands in the camera that it looks through: it turns with the next frame that it draws."""
    (client,) = bench.page.clients
    view, camera = client.view, client.handle.camera
    if view is None or abs(camera.fov - fov_of(view.eye)) > 1e-6:
        return False
    turned = vtf.SO3(np.asarray(camera.wxyz, dtype=float)).as_matrix()
    return np.allclose(turned, view.eye.rotation.T, atol=1e-5)


HOLD_BACK = """() => {
  window.heldBack = 0;
  document.addEventListener("click", (event) => {
    if (event.target.textContent !== "☰") return;
    event.stopPropagation();
    window.heldBack += 1;
  }, true);
}"""
"""no click on the button of the lanes arrives: they are counted"""


NOTICE = """() => {
  const r = document.querySelector('.mantine-Notification-root')?.getBoundingClientRect();
  return r ? [r.left, r.top, r.right, r.bottom] : null;
}"""
NAMELESS = """() => [...document.querySelectorAll('button, input, img, [role="slider"], [role="progressbar"]')].filter((one) =>
  one.offsetParent !== null && !one.getAttribute('aria-label') && !one.alt && !one.textContent.trim() && !one.labels?.length)
  .map((one) => one.outerHTML.slice(0, 150))"""
LONG = " ".join(f"Word{n} of a reason that has to be read to its end." for n in range(12))
CUT = """() => [...document.querySelectorAll('.mantine-Notification-root')].filter((one) => one.innerText.includes('Word11')).map(
  (root) => [root, ...root.querySelectorAll('*')].some((one) => getComputedStyle(one).overflow !== 'visible'
    && (one.scrollHeight > one.clientHeight + 1 || one.scrollWidth > one.clientWidth + 1)))"""
CANVAS = """() => {
  const r = window.__viserMutable.canvas.getBoundingClientRect();
  return [r.left, r.top, r.width, r.height];
}"""
HOVERED = """() => {
  let found = false;
  window.__viserMutable.scene.traverse((one) => { found ||= one.material?.color?.getHexString?.() === 'ffff40'; });
  return found;
}"""
"""whether an arrow of the handle is under the pointer: it is yellow then"""
NODES = "() => Object.keys(window.__viserMutable.nodeRefFromName)"


@pytest.mark.browser
def test_a_user_s_way_through_the_page(tmp_path, monkeypatch):
    monkeypatch.setattr(persistence, "_MERGE_S", 0.1)
    bench = in_threads(tmp_path, opener=fake_document)
    with browsing(bench) as view:
        _scene_and_hand_are_the_largest_things(bench, view)
        _keys_behind_a_dialog_do_nothing_and_escape_closes_it(bench, view)
        _moves_of_a_slider_with_rests_are_one_step(bench, view)
        _a_click_on_the_handle_is_no_edit_and_a_drag_is_one_step(bench, view)
        _what_would_be_gripped_is_named_under_the_pointer(bench, view)
        _a_click_on_the_lanes_goes_there(bench, view)
        _has_names_for_a_screen_reader(bench, view)
        _picture_and_model_are_drawn_as_one_however_large(bench, view)
        _shows_what_matters_whole_until_it_is_put_away(bench, view)
        view.page.set_viewport_size({"width": 853, "height": 533})  # at 150 %
        _panel_hides_nothing_of_a_narrow_and_low_scene(view)
        bench.web.close()
        view.page.get_by_role("alert").filter(has_text="No connection").wait_for()


def _keys_behind_a_dialog_do_nothing_and_escape_closes_it(bench, view):
    state, keys = bench.state, view.page.keyboard
    before, dialog = (state.frame, state.version), view.page.get_by_role("dialog")

    def closes():
        keys.press("Escape")
        dialog.wait_for(state="detached")
        assert (state.frame, state.version) == before

    keys.press("Shift+H")
    dialog.wait_for()
    for key in ("ArrowRight", "End", "Shift+N", "Control+z"):
        keys.press(key)
    closes()
    keys.press("Control+k")  # the palette: what is typed before it takes the letters
    keys.type("track", delay=5)
    view.page.wait_for_timeout(1000)
    closes()
    keys.press("ArrowRight")
    eventually(lambda: state.frame == before[0] + 1)
    keys.press("ArrowLeft")
    eventually(lambda: bench.stage.pose.frame == state.frame == before[0])


def _what_would_be_gripped_is_named_under_the_pointer(bench, view):
    view.page.keyboard.press("1")
    eventually(lambda: stands(bench))
    places = dict(zip(bench.stage.session.joint_names, bench.stage.pose.joints, strict=True))

    name = view.page.locator("#handtrack-held").inner_text

    def named_at(place):
        view.page.mouse.move(*view.page.evaluate(PROJECT, ["", place.tolist()]))
        view.page.wait_for_timeout(100)
        return name()

    for place, words in (
        (places["index_tip"] + [0.0, 0.04, 0.0], ""),
        (places["index_tip"], "index tip"),
        (0.5 * (places["index_mcp"] + places["index_pip"]), "index proximal"),
        (places["wrist"], "wrist"),
    ):
        eventually(lambda place=place, words=words: named_at(place) == words, words)
    view.page.keyboard.press("0")
    eventually(lambda: not name(), "the pointer rests, and the view is another")


def _a_click_on_the_handle_is_no_edit_and_a_drag_is_one_step(bench, view):
    handle, mouse, phases = bench.stage.root.control, view.page.mouse, list[str]()
    untouched = np.array(handle.wxyz)
    bench.page.edit_pose({"root_rx": 0.2, "root_ry": -0.4, "root_rz": 0.3}, "Turn")
    eventually(lambda: not np.allclose(handle.wxyz, untouched))
    before, version = bench.state.values, bench.state.version
    handle.on_update(lambda event: phases.append(event.phase))

    def on_the_arrow():
        tip = handle.position + vtf.SO3(handle.wxyz) @ np.array([0.0, 0.08, 0.0])
        centre, arrow = (
            np.array(view.page.evaluate(PROJECT, ["", p.tolist()])) for p in (handle.position, tip)
        )
        mouse.move(*arrow)
        return view.page.evaluate(HOVERED) and (arrow, arrow + 0.5 * (arrow - centre))

    eventually(on_the_arrow)
    mouse.down()
    mouse.up()
    eventually(lambda: {"start", "end"} <= {*phases}, "the click met the arrow")
    assert (bench.state.values, bench.state.version) == (before, version)
    phases.clear()
    _drag_with_rests(bench, view, *eventually(on_the_arrow))
    eventually(lambda: "end" in phases)
    moved = np.abs(np.subtract(bench.state.values, before))
    assert moved[:3].max() > 0.005 and moved[3:].max() < 1e-3, "the arrow only moves"
    _one_step_takes_all_of_it_back(bench, view, before, "move")


def _moves_of_a_slider_with_rests_are_one_step(bench, view):
    view.press("Index")
    before = bench.state.values
    box = view.row("PIP flex °").locator(".mantine-Slider-track").bounding_box()
    at = lambda share: (box["x"] + share * box["width"], box["y"] + box["height"] / 2)  # noqa: E731
    _drag_with_rests(bench, view, at(0.3), at(0.8))
    eventually(lambda: bench.layout.pose.pose.version == bench.state.version)
    _one_step_takes_all_of_it_back(bench, view, before, "index PIP flex")


def _one_step_takes_all_of_it_back(bench, view, before, words):
    view.page.keyboard.press("Control+z")
    view.page.get_by_text(f"Undone: {words}, frame 3").first.wait_for()
    eventually(lambda: bench.state.values == before)


def _drag_with_rests(bench, view, start, stop):
    """Drag in three moves; each makes an edit, and after it comes a rest that is longer than any between edits."""
    known = [bench.state.version]

    def came():
        return bench.state.version > known[-1] and not known.append(bench.state.version)

    view.drag(start, stop, 3, came, 300)


def _a_click_on_the_lanes_goes_there(bench, view):
    _tracked(bench)
    mouse, picture = view.page.mouse, view.page.locator(".handtrack-timeline svg")
    for frame in (8, 2, 10, 11):
        box = eventually(picture.bounding_box)  # they are sent anew
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
    eventually(lambda: bench.state.frame == 7)
    view.page.keyboard.press("Shift+Y")
    eventually(lambda: bench.worker.document.accepted == {7})
    view.press("Export …")  # the next step
    opened = view.page.get_by_role("tab", name="Export", exact=True, selected=True)
    eventually(opened.count)
    with view.page.expect_download() as download:
        view.press(card_words(export_format("csv")))
    rows = download.value.path().read_text(encoding="utf-8").splitlines()
    assert sum(row[:1].isdigit() for row in rows) == FRAMES


def _scene_and_hand_are_the_largest_things(bench, view):
    eventually(lambda: share(view) >= 0.7, "the scene has 70 % of the window, with the panel open")
    eventually(lambda: is_large(bench, view))
    view.page.keyboard.press("1")
    eventually(lambda: stands(bench))
    eventually(lambda: is_large(bench, view))
    low, high = hand_in_page(bench, view)
    bench.page.notify("done", "Something", "was to be said.")
    notice = eventually(lambda: view.page.evaluate(NOTICE))
    assert notice[0] > high[0] or notice[2] < low[0] or notice[3] < low[1], "beside the hand"
    view.page.keyboard.press("0")
    view.page.locator(".mantine-Notification-closeButton").first.click()


def _panel_hides_nothing_of_a_narrow_and_low_scene(view):
    ends = lambda: sum(view.page.evaluate(CANVAS)[::2])  # noqa: E731
    panel = view.page.get_by_role("tab", name="Review", exact=True)
    eventually(lambda: 853 - ends() >= WIDTH, "it ends where the panel begins")
    assert panel.is_visible()
    assert share(view, (853, 533)) >= 0.55
    view.page.keyboard.press("t")
    eventually(lambda: not panel.is_visible())
    eventually(lambda: ends() > 800, "and leaves its place to the scene")


def _has_names_for_a_screen_reader(bench, view):
    for tab in ("Track", "View", "Export", "Masks", "Pose"):
        view.show_tab(tab)
        eventually(lambda: view.page.evaluate(NAMELESS) == [], f"names in {tab}")
    assert view.page.get_by_role("main").get_by_role("heading", level=1).count() == 1
    bench.page.go_to(5)
    eventually(lambda: "Frame 5 " in view.page.title())


def _shows_what_matters_whole_until_it_is_put_away(bench, view):
    page, notify = view.page, bench.page.notify
    eventually(lambda: not page.locator(".mantine-Notification-root").count())
    bench.layout.messages.see_pose(False)  # as where there is no first pose
    notify("guide", "What to do first", "Press the button that finds the hand.")
    notify("warning", "Frame 3 fits, with low confidence", "Frame 4 as well.")
    (client,) = bench.page.clients
    tab = page.get_by_role("tab", name="Review", exact=True)
    bench.layout.room.fold(client)
    eventually(lambda: not tab.is_visible())
    notify("error", "A title that is longer than some", LONG.replace("Word", "Cause"))
    eventually(tab.is_visible, "an error is read in the panel")
    for _ in range(2):
        notify("info", "Nothing to undo", "The history ends here.")
    notify("done", "Saved", LONG)
    assert eventually(lambda: page.evaluate(CUT)) == [False]
    titles = page.locator(".mantine-Notification-title").all_inner_texts()
    assert titles == ["Saved"], "notices tell what is done, and nothing else"
    note = page.locator(".handtrack-note:visible")

    def read(text):
        return note.filter(has_text=text).count() == 1

    page.get_by_text("Paste").scroll_into_view_if_needed()
    assert note.bounding_box()["y"] > 0  # in sight, however one scrolls
    assert read("Cause11"), "gone from the scene, not from the page"
    view.press("Put away")
    eventually(lambda: read("Frame 4") and not read("Cause11"))
    view.press("Put away")
    eventually(lambda: read("Press the button") and not read("Frame 4"))
    bench.page.edit_pose({"root_tx": 0.01}, "Move")
    eventually(lambda: not read("Press the button"), "it has done its work")
    notify("warning", "Frame 7 does not fit well", "Frame 10 does.")
    box = page.get_by_role("textbox", name="Frame", exact=True)
    box.fill("11")
    box.press("Enter")
    eventually(lambda: bench.state.frame == 11)
    page.keyboard.press("Home")
    eventually(
        lambda: box.input_value() == "0", "what is typed by the link replaces another number"
    )
    page.locator("a[data-frame='10']:visible").first.click()
    eventually(lambda: bench.state.frame == 10)
    view.show_tab("Messages")
    eventually(lambda: read("Press the button") and read("Cause11") and read("Nothing to undo"))


def share(view, window=(1280, 800)):
    _, _, width, height = view.page.evaluate(CANVAS)
    return float(width * height / (window[0] * window[1]))


def is_large(bench, view):
    low, high = hand_in_page(bench, view)
    return bool(high[1] - low[1] >= 0.25 * view.page.evaluate(CANVAS)[3])


def hand_in_page(bench, view):
    """Return the corners of the box that the hand's ellipsoids have on the page [px]."""
    session, pose = bench.stage.session, bench.stage.pose
    points, _ = hand_balls(session, pose)
    places = np.array([view.page.evaluate(PROJECT, ["/hand", p.tolist()]) for p in points])
    return places.min(axis=0), places.max(axis=0)


def _picture_and_model_are_drawn_as_one_however_large(bench, view):
    (client,) = bench.page.clients
    looking, scene = bench.stage.looking, bench.server.scene
    looking.set_paint(client, "plain")
    view.page.keyboard.press("1")
    looks = eventually(lambda: client.view)
    eventually(lambda: "/screen" in str(view.page.evaluate(NODES)))
    bench.page.draw("hidden", True)  # nothing stands before the picture
    view.page.set_viewport_size({"width": 900, "height": 1000})
    times = 12.0
    zoom = Zoom((SPOT[0] + 3 / times, SPOT[1] - 2 / times), times)
    looking._change(client, lambda _: zoom)
    radius = 0.36 / looks.card.matrix[0, 0] * 0.9 / times
    place = looks.card.centre + 0.36 * looks.card.rays(np.array(SPOT))

    def off():
        """Return how far beside the spot of the picture the ball is drawn [px of the image]."""
        plain = screenshot(view)
        ball = scene.add_icosphere(
            "/ball", radius, color=(255, 0, 255), position=place, cast_shadow=False
        )
        drawn = cv2.absdiff(plain, screenshot(view)).max(axis=2) > 8
        ball.remove()
        scale = view.page.evaluate(CANVAS)[3] * looks.eye.matrix[1, 1] / looks.card.matrix[1, 1]
        ball_at = middle(drawn)
        spot = plain.min(2) > 150
        rows, columns = np.indices(spot.shape)
        near = np.hypot(columns - ball_at[0], rows - ball_at[1]) < 6 * scale  # px of the image
        return np.linalg.norm(ball_at - middle(spot & near)) / scale

    eventually(lambda: off() < 0.5, timeout=0.3)  # thirty looks: once the page has zoomed and drawn
    bench.page.draw("hidden", False)


def screenshot(view):
    """Return the page once it stands still (H, W, 3) BGR."""
    before = b""
    for _ in range(40):
        now = view.page.screenshot()
        if now == before:
            break
        before = now
        view.page.wait_for_timeout(400)
    return cv2.imdecode(np.frombuffer(before, np.uint8), cv2.IMREAD_COLOR)


def middle(seen):
    """Return where the largest patch has its middle [px]; NaN where nothing is drawn."""
    *_, boxes, centres = cv2.connectedComponentsWithStats(np.uint8(seen))
    areas = boxes[1:, cv2.CC_STAT_AREA]
    return centres[1 + areas.argmax()] if areas.size else np.full(2, np.nan)
