"""Workbench, command line, batch and Python track alike: the same numbers, the hand's size fitted and all."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handtrack import Session, Status, TrackingRun, read_npz, track_session
from handtrack.session.session_state import decide
from handtrack.session.track_session import Ended, posed_frames, request_for
from handtrack_app.engine.persistence import whole_track
from handtrack_app.protocol import Hold
from tests.app.command_line import small_recording
from tests.app.desk import working
from tests.app.waiting import eventually
from tests.session.test_run import misleading

FRAMES = 4


@pytest.fixture
def folder(tmp_path):
    """The first frames of a recording of another hand, whose size is to be fitted."""
    return small_recording(tmp_path / "session", "another_hand", FRAMES)


def tracked_by(worker, listener):
    said = len(listener.seen)
    worker.engine.track(0, FRAMES, worker.document.first_frame, anew=True)
    listener.told("Tracking finished", said)
    return whole_track(worker.document)


def test_a_first_pose_saved_on_the_page_is_where_a_headless_run_starts(folder):
    run = TrackingRun.open(Session.open(folder), {"model.fit_size": False})
    worker, listener = working(folder)
    posed = run.model.joint_params(run.initial()[1])
    posed[run.model.parameter_names.index("index_mcp_flex")] += 0.0123456789
    worker.engine.set_pose(0, tuple(posed), 1)
    worker.engine.save_pose()
    listener.told("saved")
    document = worker.document
    document.apply(decide(pose={0: None}))
    worker.stop()
    assert json.loads((folder / "init.json").read_text())["frame"] == 0
    again = TrackingRun.open(Session.open(folder), {"model.fit_size": False})
    assert again.forearm == document.run.forearm
    np.testing.assert_array_equal(again.initial()[1], document.start_params(0, anew=True))


def test_all_clients_give_the_same_bytes_of_a_session_with_keyframes_pins_and_accepted_frames(
    folder, tmp_path, handtrack
):
    corrected(folder)
    copies = [Path(shutil.copytree(folder, tmp_path / name)) for name in ("a", "b", "c")]
    run = TrackingRun.open(Session.open(copies[0]))
    assert posed_frames(run)[2].keys() == {3}
    *_, end = track_session(run)
    assert isinstance(end, Ended)
    expected = end.track
    assert expected.status.tolist().count(Status.KEYFRAME) == 1
    # each recording by a `handtrack track` of its own
    handtrack.does("batch", copies[1], "--jobs", 1, "--out", tmp_path / "out")
    worker, listener = working(copies[2])
    before = worker.document.results[1]
    found = [tracked_by(worker, listener), read_npz(copies[1] / "tracks/poses.npz")]
    worker.stop()
    for track in found:
        for name in ("frame", "status", "parameters", "parameter_std", "joint_covariance"):
            assert getattr(track, name).tobytes() == getattr(expected, name).tobytes(), name
    assert expected.parameters[1].tobytes() == before.parameters.tobytes()
    posed_run, request = request_for(run)
    *_, alone = track_session(posed_run, replace(request, fixed={2: request.fixed[2]}))
    assert alone.run.scale != end.run.scale == posed_run.scale, "whom an accepted frame shows"


def test_an_arm_that_the_first_frame_hides_is_tracked_by_in_the_workbench_too(tmp_path):
    folder = misleading(tmp_path, arm=True)
    *_, end = track_session(TrackingRun.open(Session.open(folder)))
    worker, listener = working(folder)
    found = tracked_by(worker, listener)
    worker.stop()
    assert "Tracking again" in [one.title for one in listener.notices]
    assert found.parameters.tobytes() == end.track.parameters.tobytes()


def corrected(folder):
    """Track a recording in the workbench, accept a frame, pose one by hand, and pin a joint in another."""
    worker, listener = working(folder)
    document, engine = worker.document, worker.engine
    tracked_by(worker, listener)
    engine.accept(((1, 1),))
    model = document.model
    pose = document.results[2].parameters.copy()
    pose[model.parameter_names.index("index_mcp_flex")] += 0.2
    engine.set_pose(2, tuple(pose), 1)
    bones = model.bones(model.transform.solver_params(document.results[3].parameters))
    tip = model.joint_positions(bones)[model.joint_names.index("middle_tip")]
    camera = document.session.rig.cameras[0]
    column, row = camera.project(tip[None])[0]
    engine.set_pin(3, camera.name, (column + 3.0, row), 2, Hold("middle_tip"))
    eventually(lambda: document.session.pins.of(3))
    worker.stop()
