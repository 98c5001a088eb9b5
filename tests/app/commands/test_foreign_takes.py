"""Tracks that were made from other input than the session has now are told as such, wherever they are used."""

import os
import shutil
from pathlib import Path

import pytest

from handtrack_app.engine.opening import Opening
from handtrack_app.engine.store.persistence import Persistence
from tests.app.command_line import CommandLine
from tests.session.small_session import edit


@pytest.fixture
def session(tracked, tmp_path):
    """A tracked recording, copied without its times."""
    folder = Path(shutil.copytree(tracked, tmp_path / "session", copy_function=shutil.copyfile))
    for number, file in enumerate(sorted(folder.rglob("*.*"))):
        os.utime(file, (number, number))
    return folder


def lens_changed(session: Path) -> set[str]:
    text = (session / "calibration.toml").read_text()
    (session / "calibration.toml").write_text(text.replace("matrix = [[", "matrix = [[1", 1))
    return {"calibration.toml"}


def masks_drawn_anew(session: Path) -> set[str]:
    path = sorted((session / "masks" / "cam1").iterdir())[2]
    path.write_bytes(path.read_bytes() + b"\0" * 7)
    return {"masks of cam1"}


def rate_changed(session: Path) -> set[str]:
    edit(session / "session.toml", "fps = 25.0", "fps = 50.0")
    return {"session.toml"}


def of_another_recording(session: Path) -> set[str]:
    """`tracks/` stays, all else is another recording of the same hand."""
    lens_changed(session)
    for mask in (session / "masks").rglob("*.png"):
        mask.write_bytes(mask.read_bytes() + b"\0")
    return {"calibration.toml", "masks of cam0", "masks of cam1", "masks of cam2"}


NAMED = {"calibration.toml", "session.toml", *(f"masks of cam{n}" for n in range(3))}


def told(handtrack: CommandLine, session: Path) -> list[str]:
    """What is said of them when the session is opened, by `takes`, `export` and `doctor`."""
    store = Persistence.open(Opening().document(session))
    store.restore()
    store.close()
    listed = handtrack("takes", session).err
    poses = session / "tracks" / "poses.npz"
    out = session.parent / "poses.csv"
    exported = handtrack("export", poses, "--to", "csv", "--out", out).err
    examined = handtrack("doctor", session).out
    (examined,) = [line for line in examined.splitlines() if "current track" in line] or [""]
    return [store.warning, listed, exported, examined]


@pytest.mark.parametrize(
    "change", [lens_changed, masks_drawn_anew, rate_changed, of_another_recording],
    ids=lambda change: change.__name__,
)  # fmt: skip
def test_what_was_made_from_other_input_is_told_with_what_changed(change, handtrack, session):
    changed = change(session)
    for said in told(handtrack, session):
        assert {name for name in NAMED if name in said} == changed, said


def test_a_copied_folder_and_other_settings_are_no_other_input(handtrack, session):
    edit(
        session / "session.toml",
        "[tracking]",
        "# seen on Monday\n[tracking]\nsolver.iterations = 9",
    )
    edit(session / "session.toml", 'name = "', 'name = "copy of ')
    assert told(handtrack, session) == ["", "", "", ""]


def test_a_result_alone_that_was_copied_in_is_told(handtrack, session):
    poses = (session / "tracks" / "poses.npz").read_bytes()
    shutil.rmtree(session / "tracks")
    (session / "tracks").mkdir()
    (session / "tracks" / "poses.npz").write_bytes(poses)
    lens_changed(session)
    assert all("calibration.toml" in said for said in told(handtrack, session))
