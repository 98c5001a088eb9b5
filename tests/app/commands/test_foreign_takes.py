"""Tracks that were made from other input than the session has now are told as such, wherever they are used."""

import os
import shutil
from pathlib import Path

import pytest

from handtrack_app.engine import opening
from handtrack_app.engine.store.persistence import Persistence
from tests.session.small_session import edit


@pytest.fixture
def session(tracked, tmp_path):
    """A tracked recording, copied without its times."""
    folder = Path(shutil.copytree(tracked, tmp_path / "session", copy_function=shutil.copyfile))
    for number, file in enumerate(sorted(folder.rglob("*.*"))):
        os.utime(file, (number, number))
    return folder


def of_another_recording(session):
    """`tracks/` stays; the lens, two cameras' masks and the rate are of another recording of the same hand."""
    edit(session / "calibration.toml", "matrix = [[", "matrix = [[1")
    for camera in ("cam0", "cam1"):
        path = session / "masks" / camera / "000002.png"
        path.write_bytes(path.read_bytes() + b"\0")
    edit(session / "session.toml", "fps = 25.0", "fps = 50.0")


CHANGED = {"calibration.toml", "session.toml", "masks of cam0", "masks of cam1"}


def told(handtrack, session):
    """What is said of them when the session is opened, by `takes`, `export` and `doctor`."""
    store = Persistence.open(opening.document(opening.opened(session)))
    store.restore()
    store.close()
    listed = handtrack("takes", session).err
    poses = session / "tracks" / "poses.npz"
    out = session.parent / "poses.csv"
    exported = handtrack("export", poses, "--to", "csv", "--out", out).err
    examined = handtrack("doctor", session).out
    (examined,) = [line for line in examined.splitlines() if "current track" in line] or [""]
    return [store.warning, listed, exported, examined]


def test_what_was_made_from_other_input_is_told_with_what_changed(handtrack, session):
    of_another_recording(session)
    for said in told(handtrack, session):
        assert {name for name in (*CHANGED, "masks of cam2") if name in said} == CHANGED, said


def test_a_copied_folder_and_other_settings_are_no_other_input(handtrack, session):
    edit(session / "session.toml", "[tracking]", "[tracking]\nsolver.iterations = 9")
    edit(session / "session.toml", 'name = "', 'name = "copy of ')
    assert told(handtrack, session) == ["", "", "", ""]


def test_a_result_alone_that_was_copied_in_is_told(handtrack, session):
    poses = (session / "tracks" / "poses.npz").read_bytes()
    shutil.rmtree(session / "tracks")
    (session / "tracks").mkdir()
    (session / "tracks" / "poses.npz").write_bytes(poses)
    of_another_recording(session)
    assert all("calibration.toml" in said for said in told(handtrack, session))
