"""The workbench in a real browser: pose, drag, track, cancel, download."""

import contextlib
import csv
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import viser.transforms as vtf

from handtrack.export.registry import export_format
from handtrack_app.page.panels.export import card_words
from handtrack_app.workbench import Workbench
from tests.app.desk import in_threads
from tests.app.fake_run import FRAMES, fake_document
from tests.app.waiting import eventually
from tests.experiments.workbench.chromium import CHROMIUM, DRAWN, PROJECT, chromium, there_is_one

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")


class PageUnderTest:
    """The few gestures that the test needs."""

    def __init__(self, page: Any) -> None:
        self.page = page

    def row(self, label: str) -> Any:
        exact = re.compile(rf"^{re.escape(label)}$")
        found = self.page.locator("label").filter(has_text=exact).first
        return found.locator("xpath=ancestor::div[contains(@class, 'mantine-Flex-root')][1]")

    def press(self, name: str) -> None:
        self.page.get_by_role("button", name=name, exact=True).click()

    def show_tab(self, name: str) -> None:
        if name in ("Export", "Settings", "Masks", "Cloud", "Messages"):
            self.page.get_by_role("tab", name="More", exact=True).click()
        self.page.get_by_role("tab", name=name, exact=True).click()

    def drag(self, start: tuple[float, float], stop: tuple[float, float]) -> None:
        mouse = self.page.mouse
        mouse.move(*start)
        self.page.wait_for_timeout(400)  # the page looks what is under the pointer
        mouse.down()
        for i in range(1, 9):
            mouse.move(*(a + i / 8 * (b - a) for a, b in zip(start, stop, strict=True)))
            self.page.wait_for_timeout(60)  # viser sends every 50 ms
        mouse.up()


@contextlib.contextmanager
def browsing(
    bench: Workbench, dpr: float = 0.5, size: tuple[int, int] = (1300, 800)
) -> Iterator[PageUnderTest]:
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


def stands(bench: Workbench) -> bool:
    """Return whether the first page stands in the camera that it looks through: it turns with the next frame that it draws."""
    client = next(iter(bench.server.get_clients().values()))
    view = bench.stage.looking.views.of(client.client_id)
    if view is None or abs(client.camera.fov - view.eye.fov) > 1e-6:
        return False
    turned = vtf.SO3(np.asarray(client.camera.wxyz, dtype=float)).as_matrix()
    return np.allclose(turned, view.eye.rotation, atol=1e-5)


@pytest.fixture
def opened(tmp_path):
    goes_on = threading.Event()
    stuck = lambda frame: frame == 8 and not goes_on.is_set()  # noqa: E731
    bench = in_threads(tmp_path, opener=lambda f: fake_document(f, stuck=stuck))
    with browsing(bench) as page:
        yield bench, page, goes_on


@pytest.mark.browser
def test_a_user_poses_tracks_cancels_and_exports(opened, tmp_path):
    bench, view, goes_on = opened
    _moves_a_slider(bench, view)
    _drags_the_hand(bench, view)
    _tracks(bench, view, goes_on)
    _downloads(view, tmp_path)
    goes_on.clear()
    _cancels(bench, view)


def _moves_a_slider(bench: Workbench, view: PageUnderTest) -> None:
    view.press("Thumb")
    index = bench.state.names.index("thumb_ip_flex")
    before = bench.state.values[index]
    thumb = view.row("IP flex °").get_by_role("slider")
    for _ in range(5):
        thumb.press("ArrowRight")
    eventually(lambda: abs(bench.state.values[index] - before) > 0.005, "the thumb bends")


def _drags_the_hand(bench: Workbench, view: PageUnderTest) -> None:
    before, version = bench.state.values[:6], bench.state.version
    for _ in range(3):  # a loaded machine may draw the arrow too late for the pointer
        centre, arrow = (
            view.page.evaluate(PROJECT, ["/root", p]) for p in ((0, 0, 0), (0, 0.08, 0))
        )
        along = [b - a for a, b in zip(centre, arrow, strict=True)]
        view.drag(tuple(arrow), (arrow[0] + 0.5 * along[0], arrow[1] + 0.5 * along[1]))
        moved = [after - old for after, old in zip(bench.state.values[:6], before, strict=True)]
        if max(abs(v) for v in moved[:3]) > 0.005:
            break
    assert bench.state.version > version, "the handle sent a pose"
    assert max(abs(v) for v in moved[:3]) > 0.005
    assert max(abs(v) for v in moved[3:]) < 1e-3, "the arrow only moves"


def _tracks(bench: Workbench, view: PageUnderTest, goes_on: threading.Event) -> None:
    view.show_tab("Track")
    view.press("Track all frames")
    eventually(
        lambda: view.page.get_by_role("button", name="Cancel", exact=True).is_visible(),
        "cancel can be pressed",
    )
    goes_on.set()
    view.page.get_by_text("Tracking finished").first.wait_for(timeout=60_000)
    eventually(lambda: np.all(bench.layout.timeline.strip.status >= 0), "every frame")


def _downloads(view: PageUnderTest, folder: Path) -> None:
    view.show_tab("Export")
    with view.page.expect_download() as pending:
        view.press(card_words(export_format("csv")))
    target = folder / pending.value.suggested_filename
    pending.value.save_as(target)
    rows = list(csv.DictReader(target.read_text().splitlines()))
    assert target.name == "fake.csv"
    assert [int(row["frame"]) for row in rows] == list(range(FRAMES))
    assert -35 <= float(rows[0]["index_mcp_flex_deg"]) <= 95


def _cancels(bench: Workbench, view: PageUnderTest) -> None:
    view.show_tab("Track")
    view.press("Track all frames")
    cancel = view.page.get_by_role("button", name="Cancel", exact=True)
    eventually(lambda: bench.layout.tracking.progress.done >= 2, "two frames are done")
    cancel.click()
    # how soon it stops is asked of the worker alone (test_worker.py): beside other tests the page may be late
    eventually(lambda: bench.layout.tracking.progress.state == "idle", "cancelled")
    view.page.get_by_text("Cancelled").first.wait_for()
