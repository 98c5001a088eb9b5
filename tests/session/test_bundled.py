"""Bundled sessions in a checkout, and as an installed program gives them out."""

import pytest

from handtrack.session import bundled
from handtrack.session.bundled import bundled_session


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
