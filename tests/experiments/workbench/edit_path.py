"""Measures the way of an edit: what runs from a slider's message to the moved hand, and what a tracked frame sends to a page.

python -m tests.experiments.workbench.edit_path

What the engine does once it has told the pose, pictures and all else that goes with it, is not on the way: how much of it has begun by the
time the hand moves is up to the machine's load. The engine runs on threads of the page's process, so that all can be followed. In a process of its own, two threads more take part: the one
that reads calls there ("listen") and the one that reads snapshots here ("engine").
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
import threading
import time
from pathlib import Path
from types import FrameType
from typing import Any

import handtrack
import handtrack_app
from handtrack import bundled_session
from handtrack_app.protocol import Mailbox, PoseSnapshot
from tests.app.desk import in_threads
from tests.experiments.workbench.wire import WireClient

_PRODUCT = tuple(str(Path(package.__path__[0])) for package in (handtrack, handtrack_app))
_MOVED = "move_to_pose"
_TRACKED_FRAMES = 20


class Trace:
    """Product files that run while it is on, in each thread until that has told a pose; and threads in the order in which they run them."""

    def __init__(self) -> None:
        self.moved = threading.Event()
        self.on = False

    def begin(self) -> None:
        """Follow the next edit."""
        self.files: set[str] = set()
        self.threads: list[str] = []
        self.told: set[str] = set()
        self.moved.clear()
        self.on = True

    def see(self, frame: FrameType, event: str, _: Any) -> None:
        if not self.on:
            return
        code = frame.f_code
        if not code.co_filename.startswith(_PRODUCT):
            return
        if event == "call":
            name = threading.current_thread().name
            if name in self.told:
                return
            if code is Mailbox.put.__code__ and isinstance(frame.f_locals["item"], PoseSnapshot):
                self.told.add(name)
            self.files.add(code.co_filename)
            if name not in self.threads:
                self.threads.append(name)
        elif event == "return" and code.co_name == _MOVED:
            self.on = False
            self.moved.set()


def edit_path() -> dict[str, Any]:
    """Return the figures."""
    trace = Trace()
    threading.setprofile(trace.see)
    with tempfile.TemporaryDirectory() as name:
        source, leave_out = bundled_session("open_fist_open"), shutil.ignore_patterns("tracks")
        folder = Path(shutil.copytree(source, Path(name) / "session", ignore=leave_out))
        bench = in_threads(folder).start()
        try:
            assert bench.wait_ready(300.0)
            with WireClient(bench.url) as client:
                time.sleep(3.0)
                slider = bench.layout.pose.sliders["index_pip_flex"]
                for value in (10.0, 20.0):  # the first one compiles
                    trace.begin()
                    client.set_value(slider, value)
                    assert trace.moved.wait(120.0)
                    time.sleep(2.0)
                threading.setprofile(None)  # type: ignore[arg-type]
                before = len(client.messages)
                bench.engine.track(0, _TRACKED_FRAMES, bench.stage.session.first_frame)  # type: ignore[union-attr]
                while not bench.state.progress.done:
                    time.sleep(0.05)
                while bench.state.progress.state != "idle":
                    time.sleep(0.05)
                messages = len(client.messages) - before
        finally:
            bench.stop()
    return {
        "product files from a slider's message to the moved hand": len(trace.files),
        "threads, in order": trace.threads,
        "messages a tracked frame": round(messages / _TRACKED_FRAMES, 1),
        "files": sorted(f.rpartition("/handtrack")[2] for f in trace.files),
    }


if __name__ == "__main__":
    print(json.dumps(edit_path(), indent=1))
    sys.exit()
