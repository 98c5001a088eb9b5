"""One tracking for all clients: events, fixed poses, cancelling, resuming."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handtrack.session.formats.tables import write_npz
from handtrack.session.posed_frames import keyframe_result, posed_frames
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.takes.take_recorder import TakeRecorder
from handtrack.session.track_session import (
    Ended,
    FrameTracked,
    PassBegan,
    request_for,
    track_session,
    tracking_segments,
)
from handtrack.store.history import Change
from handtrack.store.store import ACCEPTED, WritableStore
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import Status
from tests.app.command_line import small_recording


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_recording(tmp_path_factory.mktemp("tracked") / "session")


@pytest.fixture
def folder(recording: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recording, tmp_path / "session"))


def ended(events: object) -> Ended:
    *_, last = events  # pyright: ignore[reportGeneralTypeIssues]
    assert isinstance(last, Ended)
    return last


def test_a_keyframe_of_the_workbench_stays_and_its_neighbours_are_tracked_from_it(
    folder: Path,
) -> None:
    run = TrackingRun.open(Session.open(folder))
    _, params = run.initial()
    pose = run.model.joint_params(params)
    pose[run.model.parameter_names.index("index_mcp_flex")] += 0.2
    values = dict(zip(run.model.parameter_names, pose.tolist(), strict=True))
    with WritableStore(folder / "tracks", "test") as store:
        history = store.history()
        action = history.next("", [Change("pose/2", None, {"parameters": values})])
        store.write(action)
    found = posed_frames(run)
    assert list(found.fixed) == [2]
    segments = tracking_segments(run, request_for(run))
    assert 2 not in [frame for one in segments for frame in one.frames]
    assert segments[-1].first == 3
    end = ended(track_session(run))
    row = end.track.frame.tolist().index(2)
    assert end.track.status[row] == Status.KEYFRAME
    np.testing.assert_array_equal(end.track.parameters[row], pose)
    assert len(end.results) == len(run.session.frame_range)


def test_an_accepted_frame_stays_as_it_was_tracked(folder: Path) -> None:
    run = TrackingRun.open(Session.open(folder))
    with TakeRecorder(folder / "tracks/poses.npz", folder) as take:
        before = ended(track_session(run, take=take))
        write_npz(take.out, before.track)
        take.saved(before.track, finished=True)
    with WritableStore(folder / "tracks", "test") as store:
        store.write(store.history().next("", [Change(ACCEPTED, None, [[1, 2]])]))
    again = ended(track_session(run))
    row = again.track.frame.tolist().index(1)
    np.testing.assert_array_equal(again.track.parameters[row], before.track.parameters[row])


def test_a_cancelled_tracking_is_resumed_with_the_same_result(folder: Path) -> None:
    run = TrackingRun.open(Session.open(folder))
    first, params = run.initial()
    whole = run.result(run.track(run.session.frame_range, first, params))
    seen: list[int] = []
    with TakeRecorder(folder / "tracks/poses.npz", folder) as take:
        for event in track_session(run, control=Control(lambda: len(seen) >= 2), take=take):
            if isinstance(event, FrameTracked):
                seen.append(event.result.frame)
    assert isinstance(event, Ended)
    assert event.cancelled
    assert len(event.results) < len(whole)
    with TakeRecorder(folder / "tracks/poses.npz", folder) as take:
        events = list(track_session(run, take=take))
    began = next(event for event in events if isinstance(event, PassBegan))
    assert [result.frame for result in began.resumed][:2] == seen[:2]
    track = ended(events).track
    np.testing.assert_array_equal(track.parameters, whole.parameters)
    np.testing.assert_array_equal(track.joint_covariance, whole.joint_covariance)


def test_nothing_is_tracked_where_every_frame_is_fixed(folder: Path) -> None:
    run = TrackingRun.open(Session.open(folder))
    request = request_for(run)
    pose = run.model.joint_params(run.initial()[1])
    fixed = {frame: keyframe_result(run, frame, pose) for frame in request.frames}
    assert tracking_segments(run, replace(request, fixed=fixed)) == ()
