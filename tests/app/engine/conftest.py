"""A worker on a fake run; `DESK` of a test file says how that runs."""

import pytest

from tests.app.desk import a_desk


@pytest.fixture
def desk(request, tmp_path):
    yield from a_desk(tmp_path, **{"step_s": 0.0} | getattr(request.module, "DESK", {}))


@pytest.fixture
def worker(desk):
    return desk[0]


@pytest.fixture
def listener(desk):
    return desk[1]
