"""Takes the workbench's pictures of README and the other pages anew, in a real browser.

Run: python -m docs.pictures.workbench_pictures FOLDER [SCENE=SESSION ...]. Without a scene the bundled recording is tracked in a copy (FOLDER gets it, and the
pictures): `workbench_tracked`, `workbench_residual`, `workbench_all`. Of copies of other recordings: SCENE `desk`, two videos of a hand, gives
`workbench_found`, `workbench_masks` and `workbench_pins`; `stereo`, a pair of cameras, `workbench_cloud` and `workbench_stereo`; `body`, a tracked
recording of a person, `workbench_body`. Needs Chromium and the extra `test`.
"""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from handtrack.session.bundled import bundled_session
from handtrack.session.session import Session
from handtrack_app.process.child import EnginePlan
from handtrack_app.process.engine_process import EngineProcess
from handtrack_app.protocol import Hold
from handtrack_app.workbench import Workbench
from tests.experiments.workbench.chromium import DRAWN, chromium

_SIZE = (1440, 900)
_LONG_S = 600.0
_SETTLES_MS = 8000  # drawn in software
_OPEN, _PAINTED, _FOUND, _PINNED, _CLOUD = 50, 100, 189, 225, 20
"""frames that are shown"""
_MARKS = {"thumb_tip": (659.0, 229.0), "index_tip": (603.0, 335.0)}
"""of the desk's first camera, by eye [px]: tests/benchmarks/desk_two_view_marks.json"""
_STROKES = (
    ((508.0, 338.0), (524.0, 350.0), (540.0, 362.0)),
    ((546.0, 372.0), (558.0, 374.0), (566.0, 364.0)),
)
"""over the curled fingers that the desk's skin filter misses in its first camera [px]"""


class Taker:
    """A page of a workbench, and where its pictures go."""

    def __init__(self, bench: Workbench, page: Any, out: Path) -> None:
        self.bench, self.page, self.out = bench, page, out

    def until(self, test: Callable[[], Any], timeout: float = 60.0) -> None:
        """Wait; the browser goes on meanwhile."""
        until = time.monotonic() + timeout
        while not test() and time.monotonic() < until:
            self.page.wait_for_timeout(50)

    def done(self) -> None:
        """Wait until work that was asked for has ended."""
        job = self.bench.state
        self.until(lambda: job.progress.state != "idle")
        self.until(lambda: job.progress.state == "idle", _LONG_S)

    def tracked(self, first: int, stop: int, start: int) -> None:
        self.bench.engine.track(first, stop, start, anew=True)
        self.done()

    def show(self, frame: int) -> None:
        self.bench.page.go_to(frame)
        self.until(
            lambda: self.bench.stage.pose is not None and self.bench.stage.pose.frame == frame
        )

    def press(self, name: str) -> None:
        self.page.get_by_role("button", name=name, exact=True).first.click()

    def tab(self, *names: str) -> None:
        """Open a tab, and one within it."""
        for name in names:
            self.page.get_by_role("tab", name=name, exact=True).last.click()

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
    plan = EnginePlan(folder)
    bench = Workbench(plan, partial(EngineProcess, plan), port=0).start()
    try:
        bench.wait_ready(_LONG_S)
        with chromium(_SIZE) as (page, _):
            page.goto(f"{bench.url}&fixedDpr=1")
            page.wait_for_function(DRAWN, arg=["/hand/flesh"], timeout=60_000)
            taker = Taker(bench, page, out)
            taker.until(lambda: bench.state.progress.state == "idle", _LONG_S)
            page.wait_for_timeout(_SETTLES_MS)
            for client in bench.page.clients:
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
        strip = bench.state.strip
        if strip is None or (strip.status < 0).any():
            taker.tracked(0, 100, 0)
        (client,) = bench.page.clients
        taker.show(_OPEN)
        bench.stage.look(None, client, everything=True)
        taker.take("workbench_tracked")
        bench.page.draw("mode", "All")
        taker.take("workbench_all")
        bench.page.draw("mode", "Flesh")
        bent = {"index_mcp_flex": 0.5, "little_mcp_flex": 0.6}
        now = dict(zip(bench.state.names, bench.state.values, strict=True))
        bench.page.edit_pose({name: now[name] + more for name, more in bent.items()}, "picture")
        page.keyboard.press("2")
        bench.stage.looking.set_paint(client, "residual")
        bench.redraw()
        taker.take("workbench_residual")
        bench.page.travel(back=True)
        page.wait_for_timeout(1000)


def desk(out: Path, session: Path) -> None:
    """Take the pictures of two videos: the hand found, a mask painted, a frame corrected by pins."""
    (session / "init.json").unlink(missing_ok=True)
    views = {view.name: view.camera for view in Session.open(session).views}
    first, camera = next(iter(views.items()))
    with opened(session, out) as taker:
        bench = taker.bench
        taker.show(_FOUND)
        taker.press("this frame")
        taker.done()
        taker.page.keyboard.press("1")
        taker.take("workbench_found")
        taker.page.keyboard.press("0")
        taker.tracked(_PINNED - 10, _PINNED + 10, _PINNED)
        taker.show(_PINNED)
        taker.page.keyboard.press("1")
        for joint, marked in _MARKS.items():
            pixel = tuple(camera.undistort_points(np.array(marked, float)).tolist())
            bench.engine.set_pin(_PINNED, first, pixel, bench.state.version, Hold(joint))
        taker.take("workbench_pins")
        taker.show(_PAINTED)
        taker.tab("More", "Masks")
        taker.press("Paint over the mask")
        for stroke in _STROKES:
            bench.engine.paint_mask(_PAINTED, first, "hand", stroke, 9.0)
        taker.take("workbench_masks")


def stereo(out: Path, session: Path) -> None:
    """Take the pictures of a pair of cameras: the cloud of a tracked frame, and how the images were matched."""
    with opened(session, out) as taker:
        bench = taker.bench
        taker.tracked(0, 2 * _CLOUD, 0)
        taker.show(_CLOUD)
        taker.tab("More", "Cloud")
        bench.page.draw("cameras", False)
        taker.take("workbench_cloud")
        bench.page.draw("cloud_picture", "stereo")
        bench.page.draw("cloud_wide", True)
        taker.take("workbench_stereo")


def body(out: Path, session: Path) -> None:
    """Take the picture of a tracked person."""
    with opened(session, out) as taker:
        taker.show(_OPEN)
        (client,) = taker.bench.page.clients
        taker.bench.stage.look(None, client, everything=True)
        taker.take("workbench_body")


SCENES: dict[str, Callable[[Path, Path], None]] = {"desk": desk, "stereo": stereo, "body": body}


def main(folder: str, *scenes: str) -> None:
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    if not scenes:
        bundled(out)
    for scene in scenes:
        name, _, session = scene.partition("=")
        copy = out / name
        if not copy.exists():
            shutil.copytree(session, copy, copy_function=shutil.copyfile)
        SCENES[name](out, copy)


if __name__ == "__main__":
    main(*sys.argv[1:])
