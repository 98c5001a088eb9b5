"""A small session of its own for each test, and a bundled one."""

from pathlib import Path

import pytest

from handtrack import Session, bundled_session
from tests.session.small_session import make_session


@pytest.fixture(scope="module")
def session():
    return Session.open(bundled_session("open_fist_open"))


@pytest.fixture
def folder(tmp_path) -> Path:
    (tmp_path / "recording").mkdir()
    return make_session(tmp_path / "recording")
