"""Golden files: what was written once opens, and the same is written today, to the seventh digit."""

from __future__ import annotations

from dataclasses import fields

import pytest
from numpy.testing import assert_allclose

from handtrack.capture.calibration.rig_file import read_rig
from handtrack.model.model_file import read_scale
from handtrack.session import layout
from handtrack.session.first_pose import read_first_pose
from handtrack.session.session import Session
from handtrack.session.session_file import (
    CameraSettings,
    HandSettings,
    RecordingSettings,
    read_session_file,
)
from handtrack.session.tables import read_npz
from handtrack.store.store import Store
from handtrack_app.commands.batch import read_ledger
from tests.golden import recording
from tests.golden.files import (
    AGAIN,
    FOLDER,
    POSES,
    POSES_2,
    RECORDING,
    written,
)
from tests.golden.meaning import differences, meaning
from tests.golden.results import RESULTS, SCENES, tracked
from tests.store.made import files_of


def written_in(folder):
    """Return a recording's files but pictures: those are what was seen, not what we write."""
    return [name for name in files_of(folder) if not name.endswith(".png")]


def assert_the_same(before, after, name):
    """Fail naming the first places where two meanings differ."""
    found = list(differences(before, after, name))
    assert not found, f"{AGAIN}:\n" + "\n".join(found[:10])


@pytest.fixture(scope="module")
def now(tmp_path_factory):
    folder = tmp_path_factory.mktemp("exports")
    return {file.name: file for file in written(FOLDER / POSES, folder)}


@pytest.fixture(scope="module")
def recorded_now(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recording")
    recording.written(folder)
    return folder


def test_a_saved_result_of_format_2_opens():
    saved, made = read_npz(RECORDING / POSES_2), recording.sample()
    assert saved.definition is not None
    assert saved.reason.tolist() == made.reason.tolist()
    assert saved.hand_length_mm == 181.5
    assert_allclose(saved.joint_positions, made.joint_positions, atol=1e-9)


def test_a_saved_recording_opens(tmp_path):
    folder = recording.copied(RECORDING, tmp_path)
    session = Session.open(folder)
    assert (session.name, session.fps, session.camera_names) == ("simulated still", 25.0, ("cam0", "cam1"))  # fmt: skip
    assert read_rig(folder / layout.CALIBRATION_FILE)["cam1"].size == (64, 48)
    first = read_first_pose(folder / layout.INIT_FILE).xyz
    assert first.shape == (21, 3)
    assert read_first_pose(folder / "init_parameters.json").parameters == {"root_tx": 0.1, "index_mcp_flex": 0.3}  # fmt: skip
    assert read_scale(folder / layout.HAND_FILE) == recording.SCALE
    assert session.pins.frames == [0]
    assert [pin.joint or pin.bone for pin in session.pins.of(0)] == ["index_tip", "middle_metacarpal"]  # fmt: skip


def test_a_saved_session_file_with_every_key_opens():
    path = RECORDING / "session" / "session_everything.toml"
    assert read_session_file(path) == recording.EVERYTHING
    text = path.read_text(encoding="utf-8")
    for table in (RecordingSettings, HandSettings, CameraSettings):
        assert not [entry.name for entry in fields(table) if f"{entry.name} = " not in text]


def test_a_saved_take_opens(tmp_path):
    store = Store(recording.copied(RECORDING, tmp_path) / layout.TRACKS_FOLDER)
    (take,) = store.takes()
    assert take.is_finished
    assert not store.damage()
    assert len(take.steps()) == len(recording.sample())
    track = store.track_of(store.current())
    assert_allclose(track.joint_positions, recording.sample().joint_positions, atol=1e-9)
    assert [action.words for action in store.actions()] == ["handtrack track"]
    assert store.known_files() == {"5be36c545ed450b44477e102644e4b27"}


def test_a_saved_ledger_opens():
    assert tuple(read_ledger(RECORDING / "batch" / "ledger.jsonl")) == recording.OUTCOMES


def test_the_same_files_are_written(now, recorded_now):
    assert sorted(now) == sorted(file.name for file in FOLDER.iterdir() if file.name != POSES)
    assert written_in(recorded_now) == written_in(RECORDING)


@pytest.mark.parametrize("name", sorted(f.name for f in FOLDER.iterdir() if f.name != POSES))
def test_exports_of_text_are_what_they_were(now, name):
    assert_the_same(meaning(FOLDER / name), meaning(now[name]), name)


@pytest.mark.parametrize("name", written_in(RECORDING))
def test_a_recordings_files_are_what_they_were(recorded_now, name):
    if name.endswith(".log"):  # a segment of a log is read as the folder that it lies in
        before, after = ((place / name).parent for place in (RECORDING, recorded_now))
    else:
        before, after = RECORDING / name, recorded_now / name
    assert_the_same(meaning(before), meaning(after), name)


@pytest.mark.parametrize("scene", SCENES)
def test_a_small_recordings_results_are_what_they_were(tmp_path, scene):
    assert_the_same(meaning(RESULTS / f"{scene}.npz"), meaning(tracked(scene, tmp_path)), scene)
