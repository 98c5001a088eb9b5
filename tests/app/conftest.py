"""A workbench on loopback, on a fake run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from handtrack_app.workbench import Workbench
from tests.app.fake_run import fake_document


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Workbench]:
    """A started workbench that shows the fake session."""
    workbench = Workbench(tmp_path, port=0, opener=fake_document).start()
    assert workbench.wait_ready(60.0)
    yield workbench
    workbench.stop()
