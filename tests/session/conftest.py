"""A small session of its own for each test."""

from pathlib import Path

import pytest

from tests.session.small_session import make_session


@pytest.fixture
def folder(tmp_path) -> Path:
    (tmp_path / "recording").mkdir()
    return make_session(tmp_path / "recording")
