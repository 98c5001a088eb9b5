"""What a take is made from: the same for the same, another for whatever may lead to other poses."""

import os
import shutil
from pathlib import Path

import pytest

from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.takes.take_about import about_take
from tests.session.small_session import edit, make_session


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_session(tmp_path)


def made_from(folder: Path, frames: range = range(4), **overrides: object) -> dict[str, str]:
    values = {"model.fit_size": False} | {k.replace("__", "."): v for k, v in overrides.items()}
    run = TrackingRun.open(Session.open(folder), values)
    return dict(about_take(run, "a test", frames, *run.initial()).inputs)


def changed(before: dict[str, str], after: dict[str, str]) -> set[str]:
    return {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}


def test_the_same_is_the_same_wherever_it_lies(folder, tmp_path_factory):
    before = made_from(folder)
    assert made_from(folder) == before
    copy = tmp_path_factory.mktemp("copy") / "session"
    assert made_from(Path(shutil.copytree(folder, copy))) == before


def test_whatever_may_change_poses_is_another_beginning(folder):
    before = made_from(folder)
    assert changed(before, made_from(folder, range(3))) == {"frames"}
    assert changed(before, made_from(folder, solver__iterations=7)) == {"settings"}
    edit(folder / "session.toml", "fps = 10.0", "fps = 20.0")
    edit(folder / "calibration.toml", "80.0", "81.0")
    assert changed(before, made_from(folder)) == {"session.toml", "calibration.toml"}
    os.utime(folder / "masks/cam0/002.png")
    (folder / "cam0/003.png").unlink()
    now = changed(before, made_from(folder))
    assert now == {"session.toml", "calibration.toml", "masks of cam0", "images of cam0"}
