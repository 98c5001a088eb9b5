"""Clouds in a real browser: a filter's slider, and a box dragged over skin in an image."""

import numpy as np
import pytest

from handtrack_app.workbench import Workbench
from tests.app.cloudy_session import BOX, cloudy_session
from tests.app.desk import in_threads
from tests.app.page.test_browser import PageUnderTest, browsing, stands
from tests.app.waiting import eventually
from tests.experiments.workbench.chromium import PROJECT


@pytest.mark.browser
def test_a_user_filters_a_cloud(tmp_path):
    bench = in_threads(cloudy_session(tmp_path))
    with browsing(bench) as view:
        view.show_tab("Cloud")
        points = bench.stage.cloud.points
        eventually(lambda: points.visible, "the cloud is there")
        before = len(points.points)
        thumb = view.row("To hand mm").get_by_role("slider")
        thumb.press("Home")  # 0 is off: the wall comes back
        eventually(lambda: len(points.points) > before, "more points")
        _marks_skin(bench, view)
        eventually(lambda: len(points.points) <= before, "the wall is of another colour")


def _marks_skin(bench: Workbench, view: PageUnderTest) -> None:
    page = view.page
    page.get_by_text("Skin colour", exact=True).first.click()
    view.press("Drag a box over the image")
    eventually(lambda: stands(bench), "it looks through the camera")
    page.wait_for_timeout(600)
    x, y, width, height = BOX
    corners = ((x + 3, y + 3), (x + width - 3, y + height - 3))
    start, stop = (page.evaluate(PROJECT, ["/hand", _seen_at(*corner)]) for corner in corners)
    view.drag(tuple(start), tuple(stop))
    box = eventually(lambda: bench.state.display.skin_box, "the box is marked")
    np.testing.assert_allclose(box[1], (x + 3, y + 3, width - 6, height - 6), atol=1)


def _seen_at(x: float, y: float) -> list[float]:
    """Return a world point that the first camera sees at a pixel."""
    return [0.5 * (x - 47.5) / 150.0, 0.09 - 0.5 * (y - 35.5) / 150.0, 0.0]
