"""Recordings for rerun, read back; and tracking that never waits for them."""

import io
import json
import re
import subprocess
import sys

import numpy as np
import pytest

from handtrack_app.rerun_recorder import (
    RerunViewer,
    silent_environment,
)
from tests.experiments.workbench.chromium import chromium, there_is_one


def chunks(path, entity):
    chunk = pytest.importorskip("rerun.chunk")
    for part in chunk.RrdReader(str(path)).stream().filter(content=entity, is_static=False):
        yield part.to_record_batch()


def scalars(path, entity, timeline="frame"):
    found = {}
    for batch in chunks(path, entity):
        values = batch.column("Scalars:scalars").to_pylist()
        times = batch.column(timeline).to_pylist()
        found |= {t: v[0] for t, v in zip(times, values, strict=True)}
    return found


def picture(path, entity):
    from PIL import Image

    for batch in chunks(path, entity):
        blob = batch.column("EncodedImage:blob")[0].as_py()[0]
        return np.asarray(Image.open(io.BytesIO(bytes(blob))))
    raise LookupError(entity)


@pytest.fixture
def viewer(tmp_path, monkeypatch):
    pytest.importorskip("rerun_cli")
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    running = RerunViewer()
    running.start()
    yield running
    running.stop()


def test_the_viewer_keeps_no_statistics(viewer, tmp_path):
    """By what rerun itself reads as its configuration, without the second way to turn them off."""
    environment = {k: v for k, v in silent_environment().items() if k != "CI"}
    command = [sys.executable, "-m", "rerun", "analytics", "config"]
    told = subprocess.run(command, env=environment, capture_output=True, check=True)
    if sys.platform == "linux":  # elsewhere its place cannot be named
        assert json.loads(told.stdout)["analytics_enabled"] is False
    assert not list((tmp_path / "home").glob("**/analytics/*"))


@pytest.mark.browser
@pytest.mark.skipif(not there_is_one(), reason="no Chromium")
def test_the_viewers_page_asks_no_other_host(viewer):
    pytest.importorskip("playwright.sync_api")
    asked = []
    with chromium((300, 200), "--disable-gpu-compositing") as (page, _):

        def see(route):
            ours = route.request.url.startswith("http://127.0.0.1:")
            asked.extend([] if ours else [route.request.url])
            route.continue_() if ours else route.abort()

        page.route(re.compile("^http"), see)
        reading = re.compile("ReadMessages")
        with page.expect_request(reading):  # the page runs
            page.goto(viewer.page)
        page.wait_for_timeout(2000)
        connects = page.locator("link[rel=preconnect]").count()
    assert (asked, connects) == ([], 0)
