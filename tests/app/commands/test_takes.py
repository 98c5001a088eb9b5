"""`handtrack takes`: list, compare, restore, prune; and tracks that were made from other input are told as such wherever they are used."""

import errno
import io
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handtrack import read_npz
from handtrack.store.store import Store, WritableStore
from handtrack.tracking.frame.result import Step
from tests.app.command_line import FRAMES
from tests.app.opened import opened_recording
from tests.session.small_session import edit


@pytest.fixture
def session(done):
    """The small recording with three takes: as it came, refined, and one of three frames that is a centimetre off."""
    with WritableStore(done / "tracks", "a test") as store:
        first = store.take(2)
        writer = store.begin(replace(first.about, by="another", frames=(1, 4)))
        for result in first.results(range(1, 4)):
            points = result.joint_positions + [0.01, 0.0, 0.0]
            moved = result.parameters + np.eye(1, len(result.parameters))[0] * 0.01
            writer.add(
                Step(replace(result, parameters=moved, joint_positions=points, keypoints21=points))
            )
    return done


def test_takes_are_listed_with_their_size(handtrack, session):
    told = json.loads(handtrack("takes", session, "--json").out)
    assert [take["take"] for take in told["takes"]] == [1, 2, 3]
    assert told["takes"][2]["statuses"] == {"tracked": 3}
    assert told["takes"][0]["settings"]["silhouettes.weight"] == 1.0
    assert told["damage"] == []
    assert told["writer"] is None


def test_a_span_of_a_take_is_made_current_and_undone(handtrack, session):
    poses = session / "tracks/poses.npz"
    before = poses.read_bytes()
    handtrack.does("takes", session, "--restore", 3, "--frames", "2:5")
    mixed = read_npz(poses)
    assert mixed.frame.tolist() == list(range(FRAMES))
    ours = Store(session / "tracks").take(3).track()
    assert np.array_equal(mixed.at(3).joint_positions, ours.at(3).joint_positions)
    handtrack.does("takes", session, "--restore", 2)
    with np.load(io.BytesIO(before)) as old, np.load(poses) as new:
        assert set(old.files) == set(new.files)
        assert "refinement" in old.files
        assert all(
            np.array_equal(old[name], new[name], equal_nan=old[name].dtype.kind == "f")
            for name in old.files
        )
    handtrack.does("takes", session, "--restore", 1)
    assert read_npz(poses).refinement is None, "the live pass knows nothing of it"


def test_a_full_disk_leaves_both_track_and_file_as_they_were(handtrack, session, monkeypatch):
    """Whichever write fails."""
    poses = session / "tracks/poses.npz"
    before = poses.read_bytes(), Store(session / "tracks").current()

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    for place in (
        "handtrack.session.takes.write_npz",
        "handtrack.store.log.os.write",
    ):
        with monkeypatch.context() as patch:
            patch.setattr(place, full)
            ended = handtrack("takes", session, "--restore", 1)
        assert ended.code == 2 and ended.out == ""
        assert (poses.read_bytes(), Store(session / "tracks").current()) == before
    handtrack.does("takes", session, "--restore", 1)
    assert poses.read_bytes() != before[0]


def test_two_takes_are_compared(handtrack, session):
    found = json.loads(handtrack("takes", session, "--compare", 2, 3, "--json").out)
    assert found["frames_of_both"] == 3
    assert found["distance_mm"] == pytest.approx(10.0)
    assert found["energy_of_first"] == found["energy_of_second"]
    assert found["take_2_error_mm"] < found["take_3_error_mm"]
    assert found["take_2_overlap"] > 0.9 > found["take_3_overlap"] > 0.5


def test_a_take_is_removed_by_its_user_alone(handtrack, session):
    ended = handtrack("takes", session, "--prune", 2)
    assert ended.code == 2
    assert "take 2" in ended.err
    handtrack.does("takes", session, "--prune", 3)
    assert len(handtrack("takes", session).out.splitlines()) == 2
    assert handtrack("takes", session, "--restore", 3).code == 2


@pytest.fixture
def made_elsewhere(tracked, tmp_path):
    """A tracked recording, copied without its times."""
    folder = Path(shutil.copytree(tracked, tmp_path / "session", copy_function=shutil.copyfile))
    for number, file in enumerate(sorted(folder.rglob("*.*"))):
        os.utime(file, (number, number))
    return folder


def of_another_recording(made_elsewhere):
    """`tracks/` stays; the lens, two cameras' masks and the rate are of another recording of the same hand."""
    edit(made_elsewhere / "calibration.toml", "matrix = [[", "matrix = [[1")
    for camera in ("cam0", "cam1"):
        path = made_elsewhere / "masks" / camera / "000002.png"
        path.write_bytes(path.read_bytes() + b"\0")
    edit(made_elsewhere / "session.toml", "fps = 25.0", "fps = 50.0")


CHANGED = {"calibration.toml", "session.toml", "masks of cam0", "masks of cam1"}


def told(handtrack, made_elsewhere):
    """What is said of them when the session is opened, by `takes`, `export` and `doctor`."""
    store = opened_recording(made_elsewhere)
    store.close()
    listed = handtrack("takes", made_elsewhere).err
    poses = made_elsewhere / "tracks" / "poses.npz"
    out = made_elsewhere.parent / "poses.csv"
    exported = handtrack("export", poses, "--to", "csv", "--out", out).err
    examined = handtrack("doctor", made_elsewhere).out
    (examined,) = [line for line in examined.splitlines() if "current track" in line] or [""]
    return [store.warning, listed, exported, examined]


def test_what_was_made_from_other_input_is_told_with_what_changed(handtrack, made_elsewhere):
    of_another_recording(made_elsewhere)
    for said in told(handtrack, made_elsewhere):
        assert {name for name in (*CHANGED, "masks of cam2") if name in said} == CHANGED, said


def test_a_copied_folder_and_other_settings_are_no_other_input(handtrack, made_elsewhere):
    edit(made_elsewhere / "session.toml", "[tracking]", "[tracking]\nsolver.iterations = 9")
    edit(made_elsewhere / "session.toml", 'name = "', 'name = "copy of ')
    assert told(handtrack, made_elsewhere) == ["", "", "", ""]


def test_a_result_alone_that_was_copied_in_is_told(handtrack, made_elsewhere):
    poses = (made_elsewhere / "tracks" / "poses.npz").read_bytes()
    shutil.rmtree(made_elsewhere / "tracks")
    (made_elsewhere / "tracks").mkdir()
    (made_elsewhere / "tracks" / "poses.npz").write_bytes(poses)
    of_another_recording(made_elsewhere)
    assert all("calibration.toml" in said for said in told(handtrack, made_elsewhere))
