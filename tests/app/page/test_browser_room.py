"""The page at 1280 × 800 in a real browser: how large scene and hand are, where notices stand, what the browser remembers;
and what is said to the user: read whole, and there as long as it is needed."""

import re

import numpy as np
import pytest

from handtrack_app.page.panels.view import DARK, LARGE, LIGHT, USUAL, WIDTH, Taste
from handtrack_app.page.scene.model_view import hand_balls
from tests.app.desk import in_threads
from tests.app.fake_run import fake_document
from tests.app.page.test_browser import browsing, stands
from tests.app.page.test_browser_zoom import CANVAS
from tests.app.waiting import eventually
from tests.experiments.workbench.chromium import DRAWN, PROJECT

NOTICE = """() => {
  const r = document.querySelector('.mantine-Notification-root')?.getBoundingClientRect();
  return r ? [r.left, r.top, r.right, r.bottom] : null;
}"""
BELOW = """() => {
  const below = [...document.querySelectorAll('.mantine-Paper-root')].find((one) =>
    one.style.position === 'absolute' && one.querySelector('.handtrack-timeline'));
  const r = below?.getBoundingClientRect();
  return r && [r.left, r.right, innerHeight - r.bottom];
}"""
"""where the timeline stands"""
LAYOUT = """() => {
  const slider = document.querySelector('.mantine-Paper-root:has(.handtrack-timeline) .mantine-Slider-thumb').getBoundingClientRect();
  return {below: (%s)(), thumb: slider.width,
          scale: getComputedStyle(document.documentElement).getPropertyValue('--mantine-scale').trim(),
          ground: getComputedStyle(document.querySelector('canvas').closest('div[style*="background-color"]')).backgroundColor};
}""".replace("%s", BELOW)
NAMELESS = """() => [...document.querySelectorAll('button, input, img, [role="slider"], [role="progressbar"]')].filter((one) =>
  one.offsetParent !== null && !one.getAttribute('aria-label') && !one.alt && !one.textContent.trim() && !one.labels?.length)
  .map((one) => one.outerHTML.slice(0, 150))"""
LONG = " ".join(f"Word{n} of a reason that has to be read to its end." for n in range(12))
CUT = """() => [...document.querySelectorAll('.mantine-Notification-root')].filter((one) => one.innerText.includes('Word11')).map(
  (root) => [root, ...root.querySelectorAll('*')].some((one) => getComputedStyle(one).overflow !== 'visible'
    && (one.scrollHeight > one.clientHeight + 1 || one.scrollWidth > one.clientWidth + 1)))"""
KEPT = "() => Object.values(localStorage).some((kept) => kept.includes('light'))"


@pytest.mark.browser
def test_the_page(tmp_path):
    bench = in_threads(tmp_path, opener=fake_document)
    with browsing(bench, size=(1280, 800)) as view:
        _scene_and_hand_are_the_largest_things(bench, view)
        _remembers_its_colours(bench, view)
        _has_names_for_a_screen_reader(bench, view)
        _shows_what_matters_whole_until_it_is_put_away(bench, view)
        _keeps_its_style_whatever_is_folded(bench, view)
        view.page.set_viewport_size({"width": 853, "height": 533})  # at 150 %
        _panel_hides_nothing_of_a_narrow_and_low_scene(view)


def _scene_and_hand_are_the_largest_things(bench, view):
    eventually(lambda: share(view) >= 0.7, "the scene has 70 % of the window, with the panel open")
    eventually(lambda: is_large(bench, view), "freely")
    view.page.keyboard.press("1")
    eventually(lambda: stands(bench), "it looks through a camera")
    eventually(lambda: is_large(bench, view), "through a camera")
    low, high = hand_in_page(bench, view)
    bench.page.notify("done", "Something", "was to be said.")
    notice = eventually(lambda: view.page.evaluate(NOTICE), "a notice")
    assert notice[0] > high[0] or notice[2] < low[0] or notice[3] < low[1], "beside the hand"


def _remembers_its_colours(bench, view):
    (client,) = bench.server.get_clients().values()
    room = bench.layout.room
    room.change(client, colours=LIGHT)
    eventually(lambda: view.page.evaluate(KEPT), "the browser keeps them")
    view.page.reload()
    eventually(
        lambda: Taste(False, LIGHT) in [room.tastes.get(one) for one in bench.server.get_clients()],
        "remembered", timeout=120.0,
    )  # fmt: skip
    eventually(lambda: len(bench.server.get_clients()) == 1, "the page before is gone")
    view.page.wait_for_function(DRAWN, arg=["/hand/flesh", "/root"], timeout=60_000)


def _keeps_its_style_whatever_is_folded(bench, view):
    (client,) = bench.server.get_clients().values()
    looks = lambda: view.page.evaluate(LAYOUT)  # noqa: E731
    is_light = lambda: sum(map(int, re.findall(r"\d+", looks()["ground"])[:3])) > 382  # noqa: E731
    usual = looks()
    room = bench.layout.room
    eventually(lambda: room.tastes, "it has the system's colours, whichever these are")
    for chosen in (DARK, LIGHT):
        room.change(client, colours=chosen)
        eventually(lambda chosen=chosen: is_light() == (chosen == LIGHT), chosen)
    room.change(client, text=LARGE)
    eventually(lambda: looks()["scale"] != usual["scale"], "large")
    before = looks()
    room.fold(client, folded=True)
    rail = view.page.get_by_role("tab", name="Review", exact=True)
    eventually(lambda: not rail.is_visible(), "folded")
    assert looks() == before
    assert (before["below"], before["thumb"]) == ([0, 1280, 0], 2), "along the lower edge"
    room.change(client, text=USUAL)
    room.fold(client, folded=False)


def _panel_hides_nothing_of_a_narrow_and_low_scene(view):
    ends = lambda: sum(view.page.evaluate(CANVAS)[::2])  # noqa: E731
    panel = view.page.get_by_role("tab", name="Review", exact=True)
    eventually(lambda: 853 - ends() >= WIDTH, "it ends where the panel begins")
    assert panel.is_visible()
    assert share(view, (853, 533)) >= 0.55
    view.show_tab("Pose")
    history = view.page.get_by_text("Edit joints of").bounding_box()
    assert history["y"] + history["height"] < 533 - 82, "the tab has room beneath the card"
    view.page.keyboard.press("t")
    eventually(lambda: not panel.is_visible(), "the panel is hidden by a key")
    eventually(lambda: ends() > 800, "and leaves its place to the scene")


def _has_names_for_a_screen_reader(bench, view):
    for tab in ("Track", "View", "Export", "Masks", "Pose"):
        view.show_tab(tab)
        eventually(lambda: view.page.evaluate(NAMELESS) == [], f"names in {tab}")
    assert view.page.get_by_role("main").get_by_role("heading", level=1).count() == 1
    bench.page.go_to(5)
    eventually(lambda: "Frame 5 " in view.page.title(), "for screen readers, too")


def _shows_what_matters_whole_until_it_is_put_away(bench, view):
    page, notify = view.page, bench.page.notify
    bench.layout.messages.see_pose(False)  # as where there is no first pose
    notify("guide", "What to do first", "Press the button that finds the hand.")
    notify("warning", "Frame 3 fits, with low confidence", "Frame 4 as well.")
    (client,) = bench.server.get_clients().values()
    tab = page.get_by_role("tab", name="Review", exact=True)
    bench.layout.room.fold(client, folded=True)
    eventually(lambda: not tab.is_visible(), "the panel is hidden")
    notify("error", "A title that is longer than some", LONG.replace("Word", "Cause"))
    eventually(tab.is_visible, "an error is read in the panel")
    notify("info", "Nothing to undo", "The history ends here.")
    notify("done", "Saved", LONG)
    assert eventually(lambda: page.evaluate(CUT), "a notice") == [False]
    for told in ("What to do first", "low confidence", "A title that"):
        notice = page.locator(".mantine-Notification-root", has_text=told)
        assert not notice.count(), "notices tell what is done, and nothing else"
    notices = page.locator(".mantine-Notification-closeButton")
    while notices.count():
        notices.first.click()
        page.wait_for_timeout(500)

    def read(text):
        return page.locator(".handtrack-note:visible", has_text=text).count() == 1

    assert read("Cause11"), "gone from the scene, not from the page"
    view.press("Put away")
    eventually(lambda: read("Frame 4") and not read("Cause11"), "the one before it")
    view.press("Put away")
    eventually(lambda: read("Press the button") and not read("Frame 4"), "the one before it")
    bench.page.edit_pose({"root_tx": 0.01}, "Move")
    eventually(lambda: not read("Press the button"), "it has done its work")
    notify("warning", "Frame 7 does not fit well", "Frame 9 does.")
    page.locator("a[data-frame='9']:visible").first.click()
    eventually(lambda: bench.state.frame == 9, "a link leads to its frame")
    view.show_tab("Messages")
    eventually(lambda: read("Press the button") and read("Cause11"), "all can be read again")


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
