"""The workbench and the command line track with the same engine: the same numbers."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import numpy as np

from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack_app import messages as m
from handtrack_app.worker import Worker


def test_the_worker_tracks_as_a_run_does(data_dir: Path, tmp_path: Path) -> None:
    folder = tmp_path / "session"
    shutil.copytree(data_dir / "sessions" / "webxr_open_close_3cam", folder)
    with (folder / "session.toml").open("a") as file:
        file.write("\n[tracking]\nmodel.fit_size = false\n")
    run = TrackingRun.open(Session.open(folder))
    first, params = run.initial()
    expected = {result.frame: result for result in run.track(range(4), first, params)}

    seen: list[m.Snapshot] = []
    worker = Worker(folder, seen.append)
    worker.start()
    assert worker.wait_opened(60.0) is None
    worker.send(m.Track(0, 4, first))
    until = time.monotonic() + 60
    while not any(isinstance(s, m.Notice) and s.title == "Tracking finished" for s in seen):
        assert time.monotonic() < until, "tracking did not finish"
        time.sleep(0.02)
    document = worker._document
    worker.stop()
    assert document is not None
    assert sorted(document.results) == [0, 1, 2, 3]
    for frame, result in expected.items():
        np.testing.assert_array_equal(document.results[frame].parameters, result.parameters)
