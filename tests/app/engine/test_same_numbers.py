"""Workbench, command line, batch and Python track alike: the same numbers, the hand's size fitted and all."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from handtrack.session.formats.tables import read_npz
from handtrack.session.posed_frames import posed_frames
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.track_session import Ended, track_session
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack_app.engine.store import edits
from handtrack_app.engine.store.tracks import whole_track
from handtrack_app.engine.worker import Worker
from handtrack_app.protocol import snapshots
from handtrack_app.protocol.calls import Call
from tests.app.calls import call
from tests.app.command_line import FRAMES as COUNT
from tests.app.command_line import CommandLine, small_recording

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


def test_all_clients_give_the_same_bytes_of_a_session_with_keyframes_pins_and_accepted_frames(
    tmp_path: Path, handtrack: CommandLine
) -> None:
    folder = small_recording(tmp_path / "session")
    corrected(folder)
    copies = [Path(shutil.copytree(folder, tmp_path / name)) for name in ("a", "b", "c", "d")]
    *_, end = track_session(TrackingRun.open(Session.open(copies[0])))
    assert isinstance(end, Ended)
    expected = end.track
    assert expected.status.tolist().count(Status.KEYFRAME) == 1
    assert handtrack("track", copies[1]).code == 0
    assert handtrack("batch", copies[2], "--jobs", 1, "--out", tmp_path / "out").code == 0
    worker, seen = opened(copies[3])
    before = worker.document.results[1]
    tracked_by(worker, seen, call("track", 0, COUNT, worker.document.first_frame, anew=True))
    found = [whole_track(worker.document), *(read_npz(c / "tracks/poses.npz") for c in copies[1:3])]
    worker.stop()
    for track in found:
        for name in ("frame", "status", "parameters", "parameter_std", "joint_covariance"):
            assert getattr(track, name).tobytes() == getattr(expected, name).tobytes(), name
    assert expected.parameters[1].tobytes() == before.parameters.tobytes(), "it was accepted"


def corrected(folder: Path) -> None:
    """Track a recording in the workbench, accept a frame, pose one by hand, and pin a joint in another."""
    worker, seen = opened(folder)
    document, engine = worker.document, worker.engine
    tracked_by(worker, seen, call("track", 0, COUNT, document.first_frame, anew=True))
    engine.accept(((1, 1),))
    model = document.model
    pose = document.results[2].parameters.copy()
    pose[model.parameter_names.index("index_mcp_flex")] += 0.2
    engine.set_pose(2, tuple(pose), 1)
    bones = model.bones(model.transform.solver_params(document.results[4].parameters))
    tip = model.joint_positions(bones)[model.joint_names.index("middle_tip")]
    camera = document.run.session.rig.cameras[0]
    column, row = camera.project(tip[None])[0]
    engine.set_pin(4, camera.name, (column + 3.0, row), 2, joint="middle_tip")
    until = time.monotonic() + 60
    while not document.run.session.pins.of(4):
        assert time.monotonic() < until, "no pin"
        time.sleep(0.02)
    worker.stop()
    assert posed_frames(TrackingRun.open(Session.open(folder))).guides.keys() == {4}


def opened(folder: Path) -> tuple[Worker, list[snapshots.Snapshot]]:
    seen: list[snapshots.Snapshot] = []
    worker = Worker(folder, seen.append)
    worker.start()
    assert worker.wait_opened(60.0) is None
    return worker, seen
