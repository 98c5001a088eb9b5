"""Measures how many frames a second the workbench's engine follows running cameras: what `handtrack bench as_if_live` prints.

python -m handtrack_app.engine.live.live_pace FRAMES_A_SECOND…
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import D3, Array, H, W
from handtrack.errors import HandtrackError
from handtrack.session.bundled import bundled_session
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack_app.engine.live.live_control import open_live_document
from handtrack_app.engine.live.live_options import LiveOptions
from handtrack_app.engine.run import Run
from handtrack_app.engine.worker import Worker
from handtrack_app.protocol import commands, snapshots

_FPS = 30.0
_STILL_S = 10.0  # the first pose is held, while the program opens and begins to track
_ROUNDS = 2  # of the recording, forward and backward


def pace(devices: Mapping[str, str], rate: float) -> dict[str, object]:
    """Return the figures of tracking the bundled hand, videos played as cameras at so many times their pace."""
    seen: list[tuple[float, FrameResult]] = []
    opened, idle = threading.Event(), threading.Event()
    shown: dict[str, int] = {}

    def publish(snapshot: snapshots.Snapshot) -> None:
        kind = type(snapshot).__name__
        shown[kind] = shown.get(kind, 0) + 1
        if isinstance(snapshot, snapshots.ProgressSnapshot) and snapshot.state == "idle":
            (idle if seen else opened).set()

    def watch(_: Run, result: FrameResult) -> None:
        seen.append((time.monotonic(), result))

    opener = partial(open_live_document, LiveOptions(devices, 0.05, rate=rate))
    worker = Worker(bundled_session(), publish, opener, watch)
    worker.start()
    opened.wait(120.0)
    began_s = time.process_time()
    worker.send(commands.WantPictures(True, None, "outline"))  # as the page asks for
    worker.send(commands.TrackLive())
    idle.wait(600.0)  # the files' end ends tracking
    spent_s = time.process_time() - began_s
    feed = worker.document.run.session.live
    assert feed is not None
    counts, zero_s = list(feed.counts.values()), feed.zero_s
    worker.stop(20.0)
    moving = [(when, result) for when, result in seen if result.time_s > _STILL_S / rate]
    if len(moving) < 3:
        raise HandtrackError(
            f"as_if_live: {len(moving)} frames were solved while the hand moved: this machine is too busy to be measured."
        )
    ends = np.array([when for when, _ in moving])
    late = ends - zero_s - np.array([result.time_s for _, result in moving])
    steps = np.diff(ends)
    lost = sum(result.status == Status.LOST for _, result in moving)
    return {
        "solved_a_second": len(steps) / float(steps.sum()),
        "solved": len(moving),
        "cpu_ms_a_frame": 1e3 * spent_s / len(seen),
        "dropped": max(count.dropped for count in counts),
        "missing": max(count.missing for count in counts),
        "lost": int(lost),
        "median_step_ms": 1e3 * float(np.median(steps)),
        "slowest_step_ms": 1e3 * float(steps.max()),
        "steps_above_50_ms": int((steps > 0.05).sum()),
        "median_image_to_pose_ms": 1e3 * float(np.median(late)),
        "slowest_image_to_pose_ms": 1e3 * float(late.max()),
        "poses_shown": shown.get("PoseSnapshot", 0),
        "pictures_shown": shown.get("PictureSnapshot", 0),
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


def main(rates: list[float]) -> int:
    """Print the figures by images a second as JSON."""
    session = Session.open(bundled_session())
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
    print(json.dumps(figures))
    return 0


if __name__ == "__main__":
    raise SystemExit(main([float(text) for text in sys.argv[1:]]))
