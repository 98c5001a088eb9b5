"""Clouds and masks in a real browser: a filter's slider, a box dragged over skin; a method chosen, a stroke painted over a camera's image, carried and undone; where a ray meets the image."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.app.cloudy_session import BOX, cloudy_session
from tests.app.desk import in_threads
from tests.app.page.test_browser import browsing, stands
from tests.app.waiting import eventually
from tests.app.wire import WireClient
from tests.experiments.workbench.chromium import PROJECT

BRUSH = "() => document.getElementById('handtrack-brush').getBoundingClientRect().width"


@pytest.mark.browser
def test_a_user_filters_a_cloud_tries_a_method_and_paints(tmp_path):
    bench = in_threads(cloudy_session(tmp_path))
    with browsing(bench) as view:
        page = view.page
        _filters(bench, view)
        view.show_tab("Masks")
        view.row("Masks from").locator("input:visible").click()
        page.get_by_role("option", name="skin, fixed colours").click()
        eventually(lambda: bench.layout.masks.sheet.content)
        assert page.evaluate("document.activeElement.tagName") == "BODY", "keys act again"
        view.press("Paint over the mask")
        eventually(lambda: stands(bench))
        page.wait_for_function("document.body.dataset.brush > 0")
        spots = [(18.0, 50.0), (24.0, 50.0), (30.0, 50.0)]
        start, *_, stop = (page.evaluate(PROJECT, ["/hand", _seen_at(*spot)]) for spot in spots)
        view.drag(tuple(start), tuple(stop))
        eventually(lambda: _reach_is_off(bench, (8, 40, 40, 60)) < 3, "a round stroke of 10 px")
        brushes = bench.layout.masks.correcting
        page.keyboard.press("]")
        eventually(lambda: brushes.radius.value == 12)
        scale = np.linalg.norm(np.subtract(stop, start)) / 12.0

        def circle_fits():
            page.mouse.move(*start)
            page.mouse.move(*stop)
            return abs(page.evaluate(BRUSH) / (24.0 * scale) - 1.0) < 0.05

        eventually(circle_fits)
        page.keyboard.press("x")
        eventually(lambda: brushes.brush.value == "not hand")
        with WireClient(bench.url):
            eventually(lambda: len(bench.page.clients) == 2)
            painter, other = bench.page.clients
            bench.stage.look("cam1", other)
            assert bench.stage.marking, "its look is its own"
        view.press("Done painting")
        eventually(lambda: painter.modal is None, "letters mean what they did")
        eventually(lambda: not bench.stage.marking)
        bench.page.travel(back=True)
        corrections = bench.worker.document.session.view("cam0").corrections  # type: ignore[union-attr]
        eventually(lambda: not corrections.frames)


def _reach_is_off(bench, wanted):
    """Return how far what is painted as hand reaches elsewhere than wanted: left, right, top, bottom [px]."""
    view = bench.worker.document.session.view("cam0")  # type: ignore[union-attr]
    painted = np.argwhere(view.corrections.layer(0) == 255)
    if not len(painted):
        return float("inf")
    (top, left), (bottom, right) = painted.min(axis=0), painted.max(axis=0)
    return float(np.abs(np.subtract((left, right, top, bottom), wanted)).max())


def _filters(bench, view):
    view.show_tab("Cloud")
    points = bench.stage.cloud.points
    eventually(lambda: points.visible)
    before = len(points.points)
    thumb = view.row("To hand mm").get_by_role("slider")
    thumb.press("Home")  # 0 is off: the wall comes back
    eventually(lambda: len(points.points) > before)
    _marks_skin(bench, view)
    eventually(lambda: len(points.points) <= before, "the wall is of another colour")


def _marks_skin(bench, view):
    page, skin, boxes = view.page, bench.layout.cloud.skin, []
    take = skin.take
    skin.take = lambda box: (boxes.append(box), take(box))
    page.get_by_text("Skin colour", exact=True).first.click()
    view.press("Drag a box over the image")
    eventually(lambda: stands(bench))
    page.get_by_text("Drag a box over skin").first.wait_for()
    x, y, width, height = BOX
    corners = ((x + 3, y + 3), (x + width - 3, y + height - 3))
    start, stop = (page.evaluate(PROJECT, ["/hand", _seen_at(*corner)]) for corner in corners)
    view.drag(tuple(start), tuple(stop))
    (box,) = eventually(lambda: boxes)
    assert_allclose(box, (x + 3, y + 3, width - 6, height - 6), atol=1)


def _seen_at(x, y):
    """Return a world point that the first camera sees at a pixel."""
    return [0.5 * (x - 47.5) / 150.0, 0.09 - 0.5 * (y - 35.5) / 150.0, 0.0]
