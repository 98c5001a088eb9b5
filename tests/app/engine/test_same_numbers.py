"""The workbench and the command line track with the same engine: the same numbers, the hand's size fitted and all."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine.store import edits
from handtrack_app.engine.worker import Worker
from handtrack_app.protocol import snapshots
from handtrack_app.protocol.calls import Call
from tests.app.calls import call
from tests.app.command_line import FRAMES as COUNT
from tests.app.command_line import small_recording

FRAMES = range(COUNT)

MASKS, DEPTH = "another_hand", "webxr_depth_640"


@pytest.fixture
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """The first frames of a recording of another hand, whose size is to be fitted: masks, or clouds."""
    name = getattr(request, "param", MASKS)
    target = tmp_path / "session"
    if name == MASKS:
        return small_recording(target, name)
    source = request.getfixturevalue("data_dir") / "sessions" / name
    late = {f"{frame:06d}.png" for frame in range(FRAMES.stop, 1000)}
    shutil.copytree(source, target, ignore=lambda _, names: late & set(names) | {"truth.npz"})
    assert Session.open(target).frame_count == FRAMES.stop
    return target


def tracked_by(
    worker: Worker, seen: list[snapshots.Snapshot], order: Call
) -> dict[int, FrameResult]:
    said = len(seen)
    worker.send(order)
    until = time.monotonic() + 90
    while not any(
        isinstance(s, snapshots.Notice) and s.title == "Tracking finished" for s in seen[said:]
    ):
        assert time.monotonic() < until, "tracking did not finish"
        time.sleep(0.02)
    assert worker.document is not None
    return dict(worker.document.results)


@pytest.mark.parametrize("folder", [MASKS, DEPTH], indirect=True)
def test_the_workbench_gives_the_numbers_of_a_headless_run(folder: Path) -> None:
    run = TrackingRun.open(Session.open(folder))
    assert run.session.hand_scale == "fit"
    first, params = run.initial()
    expected = {result.frame: result for result in run.track(FRAMES, first, params)}

    seen: list[snapshots.Snapshot] = []
    worker = Worker(folder, seen.append)
    worker.start()
    assert worker.wait_opened(60.0) is None
    everything = call("track", 0, FRAMES.stop, first, anew=True)
    try:
        once = tracked_by(worker, seen, everything)
        again = tracked_by(worker, seen, everything)  # not from what was tracked before
        assert worker.document is not None
        assert worker.document.live_scale == run.scale  # refining found another from it
    finally:
        worker.stop()
    for found in (once, again):
        assert sorted(found) == list(FRAMES)
        for frame, result in expected.items():
            np.testing.assert_array_equal(found[frame].parameters, result.parameters)
            np.testing.assert_array_equal(found[frame].parameter_std, result.parameter_std)
            assert found[frame].energy == result.energy


def test_a_first_pose_saved_on_the_page_is_where_a_headless_run_starts(folder: Path) -> None:
    run = TrackingRun.open(Session.open(folder), {"model.fit_size": False})
    seen: list[snapshots.Snapshot] = []
    worker = Worker(folder, seen.append)
    worker.start()
    assert worker.wait_opened(60.0) is None
    posed = run.model.joint_params(run.initial()[1])
    posed[run.model.parameter_names.index("index_mcp_flex")] += 0.0123456789
    worker.engine.set_pose(0, tuple(posed), 1)
    worker.engine.save_pose()
    until = time.monotonic() + 20
    while not any(isinstance(s, snapshots.Notice) and "saved" in s.title for s in seen):
        assert time.monotonic() < until, "not saved"
        time.sleep(0.02)
    assert worker.document is not None
    document = worker.document
    document.apply(edits.forgotten_pose(0))
    worker.stop()
    assert json.loads((folder / "init.json").read_text())["frame"] == 0
    again = TrackingRun.open(Session.open(folder), {"model.fit_size": False})
    assert again.forearm == document.run.forearm
    np.testing.assert_array_equal(again.initial()[1], document.start_params(0, anew=True))
