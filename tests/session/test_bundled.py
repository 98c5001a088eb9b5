"""Bundled sessions in a checkout, and as an installed program gives them out."""

from __future__ import annotations

import pytest

from handtrack.errors import HandtrackError
from handtrack.session import bundled
from handtrack.session.bundled import bundled_names, bundled_session
from tests.conftest import REPOSITORY


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Pretend to be a wheel: the recordings lie in the package, the working copies elsewhere."""
    shelf = tmp_path / "site-packages" / "handtrack" / "bundled_sessions"
    (shelf / "fist" / "masks").mkdir(parents=True)
    (shelf / "fist" / "session.toml").write_text("[session]")
    (shelf / "fist" / "masks" / "0.png").write_text("mask")
    monkeypatch.setattr(bundled, "_INSTALLED", shelf)
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    return shelf


def test_a_checkout_uses_its_own_folder():
    for name in bundled_names():
        assert bundled_session(name) == REPOSITORY / "sessions" / name


def test_an_installed_program_gives_out_a_working_copy(installed, tmp_path):
    folder = bundled_session("fist")
    assert folder == tmp_path / "home" / "sessions" / "fist"
    assert (folder / "masks" / "0.png").read_text() == "mask"


def test_the_users_work_is_kept_and_a_short_copy_completed(installed):
    folder = bundled_session("fist")
    (folder / "session.toml").write_text("my own settings")
    (folder / "masks" / "0.png").unlink()
    assert bundled_session("fist") == folder
    assert (folder / "session.toml").read_text() == "my own settings"
    assert (folder / "masks" / "0.png").read_text() == "mask"


def test_an_unknown_name_names_the_known(installed):
    with pytest.raises(HandtrackError) as error:
        bundled_session("foot")
    assert str(error.value) == "no bundled session 'foot'; known: fist"


def test_a_home_that_cannot_be_written_is_said(installed, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "file"))
    with pytest.raises(HandtrackError, match="cannot be copied to .*HANDTRACK_HOME"):
        bundled_session("fist")
