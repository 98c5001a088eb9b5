"""Benchmark: three cameras of 640 × 480 followed as if live, with segmentation by colour and what the page is shown.

python -m tests.experiments.speed.as_if_live FRAMES_A_SECOND…
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from handtrack import HandtrackError, Session, Status, TrackingRun, bundled_session
from handtrack.arrays import D3, Array, H, W
from handtrack.bench.measuring import alone
from handtrack_app import protocol
from handtrack_app.engine.live_control import open_live_document
from handtrack_app.process.child import EnginePlan, LiveOptions
from tests.app.desk import EngineInThreads

_FPS = 30.0
_STILL_S = 10.0  # the first pose is held, while the program opens and begins to track
_ROUNDS = 2  # of the recording, forward and backward
_RATES = (30, 60)
"""images a second; more than can be followed tells the highest rate"""


def as_if_live() -> dict[str, Any]:
    """Return frames solved a second, dropped ones and the slowest frame, the bundled videos being played as cameras.

    The page's side is the application's, so that it runs in a process of its own, with all cores; its page is not drawn.
    """
    figures = _at(_RATES, threads="")
    highest = max(figures[f"at_{rate}_fps_solved_a_second"] for rate in _RATES)
    return {
        "ratio": 30.0 / highest,
        "reference": "30 frames a second; ours the highest rate reached",
    } | figures


def pace(devices: Mapping[str, str], rate: float) -> dict[str, object]:
    """Return the figures of tracking the bundled hand, videos played as cameras at so many times their pace."""
    shown: list[tuple[float, int]] = []
    opened, idle = threading.Event(), threading.Event()
    pictures: list[float] = []

    def publish(snapshot: protocol.Snapshot) -> None:
        now = time.monotonic()
        match snapshot:
            case protocol.ProgressSnapshot(state="idle"):
                opened.set()
            case protocol.Notice(title="Tracking ended" | "Tracking stopped"):
                idle.set()
            case protocol.PictureSnapshot():
                pictures.append(now)
            case protocol.PoseSnapshot() if not shown or snapshot.frame > shown[-1][1]:
                shown.append((now, snapshot.frame))  # a frame solved anew does not count again

    opener = partial(open_live_document, LiveOptions(devices, 0.05, rate=rate))
    worker = EngineInThreads(EnginePlan(bundled_session("open_fist_open"), opener=opener), publish)
    worker.start()
    opened.wait(120.0)
    began_s = time.process_time()
    worker.engine.want_pictures(True, "outline")  # as the page asks for
    worker.engine.track_live()
    idle.wait(600.0)  # the files' end ends tracking
    spent_s = time.process_time() - began_s
    feed = worker.document.session.live
    assert feed is not None
    counts, results = list(feed.counts.values()), list(worker.document.results.values())
    taken = {frame: feed.time_s(frame) for _, frame in shown}
    worker.stop(20.0)
    held_s = _STILL_S / rate
    moving = [(when, f, t) for when, f in shown if (t := taken[f]) is not None and t > held_s]
    if len(moving) < 3:
        raise HandtrackError(
            f"as_if_live: {len(moving)} poses were shown while the hand moved: this machine is too busy to be measured."
        )
    when, frame, time_s = (np.array(column) for column in zip(*moving, strict=True))
    late, steps = when - feed._zero_s - time_s, np.diff(when)
    return {
        "solved_a_second": float(frame[-1] - frame[0]) / float(when[-1] - when[0]),
        "solved": int(frame[-1] - frame[0]) + 1,
        "cpu_ms_a_frame": 1e3 * spent_s / max(int(frame[-1]), 1),
        "dropped": max(count["dropped"] for count in counts),
        "missing": max(count["missing"] for count in counts),
        "lost": sum(result.status == Status.LOST for result in results),
        "poses_shown": len(moving),
        "median_ms_between_poses": 1e3 * float(np.median(steps)),
        "most_ms_between_poses": 1e3 * float(steps.max()),
        "median_image_to_pose_ms": 1e3 * float(np.median(late)),
        "slowest_image_to_pose_ms": 1e3 * float(late.max()),
        "pictures_shown": len(pictures),
    }


def _played(path: Path, images: Sequence[Array[H, W, D3]]) -> str:
    """Write the images to and fro as a video, the first one held; return its path."""
    size = images[0].shape[1::-1]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), _FPS, size)
    held = [images[0]] * round(_STILL_S * _FPS)
    for image in [*held, *[*images, *images[::-1]] * _ROUNDS]:
        writer.write(image)
    writer.release()
    return str(path)


@alone
def _at(rates: Sequence[int]) -> dict[str, object]:
    """Return the figures by images a second."""
    session = Session.open(bundled_session("open_fist_open"))
    run = TrackingRun.open(session, {"model.fit_size": False})
    start, params = run.initial()
    for _ in run.track(range(start, start + 4), start, params):
        pass  # kernels are loaded before the clock runs
    figures: dict[str, object] = {"load_before": os.getloadavg()[0]}
    with tempfile.TemporaryDirectory() as folder:
        devices: dict[str, str] = {}
        for name in session.rig.names:
            seen = [session.image(name, frame) for frame in session.frame_range]
            images = [image for image in seen if image is not None]
            devices[name] = _played(Path(folder) / f"{name}.avi", images)
        for rate in rates:
            found = pace(devices, rate / _FPS)
            figures |= {f"at_{rate:g}_fps_{name}": value for name, value in found.items()}
    return figures
