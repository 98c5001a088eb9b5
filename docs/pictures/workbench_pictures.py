"""Takes the workbench's pictures of README and tutorial anew, in a real browser. Run: python -m docs.pictures.workbench_pictures FOLDER [SESSION].

It tracks the bundled recording in a copy (FOLDER gets it, and the pictures), and takes `workbench_tracked`, `workbench_residual` and
`workbench_all`. SESSION: a tracked recording with pins, of which `workbench_pins` is taken. Needs Chromium and the extra `test`.
"""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image

from handtrack.session.bundled import bundled_session
from handtrack_app.process.child import EnginePlan
from handtrack_app.workbench import Workbench
from tests.experiments.workbench.chromium import DRAWN, chromium

_SIZE = (1440, 900)
_LONG_S = 600.0
_SETTLES_MS = 8000  # drawn in software
_OPEN, _PINNED = 50, 225
"""frames that are shown"""


class Taker:
    """A page of a workbench, and where its pictures go."""

    def __init__(self, bench: Workbench, page: Any, out: Path) -> None:
        self.bench, self.page, self.out = bench, page, out

    def until(self, test: Callable[[], Any], timeout: float = 60.0) -> None:
        """Wait; the browser goes on meanwhile."""
        until = time.monotonic() + timeout
        while not test() and time.monotonic() < until:
            self.page.wait_for_timeout(50)

    def show(self, frame: int) -> None:
        self.bench.page.go_to(frame)
        self.until(
            lambda: self.bench.stage.pose is not None and self.bench.stage.pose.frame == frame
        )

    def take(self, name: str) -> None:
        """Take a picture once the page is drawn, without notices."""
        for client in self.bench.server.get_clients().values():
            client.gui.add_html("<style>.mantine-Notifications-root{display:none}</style>")
        self.page.mouse.move(_SIZE[0] // 2, _SIZE[1] - 300)
        self.page.wait_for_timeout(_SETTLES_MS)
        path = self.out / f"{name}.png"
        self.page.screenshot(path=path)
        save_small(path, path)


def save_small(picture: Path, path: Path) -> None:
    """Write a picture in half of its bytes, with 256 colours: everybody downloads it with the page."""
    with Image.open(picture) as image:
        small = image.convert("RGB").quantize(256)
    small.save(path, optimize=True)


@contextmanager
def opened(folder: Path, out: Path) -> Iterator[Taker]:
    """Show a recording in a browser."""
    bench = Workbench(folder, port=0, plan=EnginePlan(folder)).start()
    try:
        bench.wait_ready(_LONG_S)
        with chromium(_SIZE) as (page, _):
            page.goto(f"{bench.url}&fixedDpr=1")
            page.wait_for_function(DRAWN, arg=["/hand/flesh"], timeout=60_000)
            taker = Taker(bench, page, out)
            taker.until(lambda: bench.layout.tracking.progress.state == "idle", _LONG_S)
            page.wait_for_timeout(_SETTLES_MS)
            for client in bench.server.get_clients().values():
                bench.layout.room.change(client, folded=False)
            yield taker
    finally:
        bench.stop()


def bundled(out: Path) -> None:
    """Take the pictures of the bundled recording."""
    copy = out / "another_hand"
    if not copy.exists():
        shutil.copytree(bundled_session(), copy)
    with opened(copy, out) as taker:
        bench, page = taker.bench, taker.page
        strip = bench.layout.timeline.strip
        if strip is None or (strip.status < 0).any():
            bench.engine.track(0, 100, 0, anew=True)
            state = bench.layout.tracking
            taker.until(lambda: state.progress.state != "idle")
            taker.until(lambda: state.progress.state == "idle", _LONG_S)
        (client,) = bench.server.get_clients().values()
        taker.show(_OPEN)
        bench.stage.look(None, client, everything=True)
        taker.take("workbench_tracked")
        bench.page.draw("mode", "All")
        taker.take("workbench_all")
        bench.page.draw("mode", "Flesh")
        bent = {"index_mcp_flex": 0.5, "little_mcp_flex": 0.6}
        values = bench.state.value_of
        bench.page.edit_pose({name: values(name) + more for name, more in bent.items()}, "picture")
        page.keyboard.press("2")
        bench.stage.looking.set_paint(client.client_id, "residual")
        bench.redraw()
        taker.take("workbench_residual")
        bench.page.travel(back=True)
        page.wait_for_timeout(1000)


def pinned(session: Path, out: Path) -> None:
    """Take the picture of a frame that was corrected by pins."""
    with opened(session, out) as taker:
        taker.show(_PINNED)
        taker.page.mouse.click(_SIZE[0] // 2, 60)
        taker.page.keyboard.press("1")
        taker.take("workbench_pins")


def main(folder: str, session: str | None = None) -> None:
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    bundled(out)
    if session is not None:
        pinned(Path(session), out)


if __name__ == "__main__":
    main(*sys.argv[1:])
