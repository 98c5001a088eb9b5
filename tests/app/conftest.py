"""A workbench on loopback, on a fake run; the command line on small recordings."""

import shutil
from contextlib import suppress
from pathlib import Path

import pytest

from handtrack import HandtrackError
from handtrack_app.cli import main
from handtrack_app.engine.persistence import Persistence
from tests.app.cloudy_session import cloudy_session
from tests.app.command_line import CommandLine, small_recording
from tests.app.desk import shown, working
from tests.app.fake_run import fake_document
from tests.app.waiting import eventually
from tests.app.wire import Browser, WireClient


@pytest.fixture
def bench(tmp_path):
    """A started workbench that shows the fake session."""
    with shown(tmp_path, opener=fake_document) as workbench:
        yield workbench


@pytest.fixture
def wire(bench):
    """A page of that workbench: the one that edits."""
    with WireClient(bench.url) as client:
        yield client


@pytest.fixture
def page(bench, wire):
    """What that page does with its camera and keys."""
    return Browser(bench, wire)


@pytest.fixture
def pages(bench):
    """Two pages of that workbench."""
    with WireClient(bench.url) as one, WireClient(bench.url) as other:
        eventually(lambda: len(bench.server.get_clients()) == 2)
        yield one, other


@pytest.fixture
def left_open(monkeypatch):
    """Stores that a test leaves open, as a crash would, are closed after it; who left them is taken for dead."""
    monkeypatch.setattr("handtrack.store.lease._runs", lambda _holder: False)
    opened: list[Persistence] = []
    really = Persistence.open

    def remembered(*given, **named):
        opened.append(really(*given, **named))
        return opened[-1]

    monkeypatch.setattr(Persistence, "open", remembered)
    yield
    for store in opened:
        with suppress(HandtrackError, OSError):
            store.close()


@pytest.fixture
def handtrack(capsys):
    """`handtrack` in this process."""
    return CommandLine(capsys)


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """A small recording; not to be changed."""
    return small_recording(tmp_path_factory.mktemp("recorded") / "small")


@pytest.fixture(scope="session")
def tracked(recorded, tmp_path_factory):
    """The small recording with its result; not to be changed."""
    folder = Path(shutil.copytree(recorded, tmp_path_factory.mktemp("tracked") / "small"))
    assert main(["track", str(folder)]) == 0
    return folder


@pytest.fixture
def done(tracked, tmp_path):
    """The small recording with its result, which the test may change."""
    return Path(shutil.copytree(tracked, tmp_path / "session"))


@pytest.fixture
def session(recorded, tmp_path):
    """The small recording, which the test may change."""
    return Path(shutil.copytree(recorded, tmp_path / "session"))


@pytest.fixture
def cloudy_desk(tmp_path):
    """A worker with a recording of three frames open that has clouds, and images without masks; and all that it says."""
    worker, listener = working(cloudy_session(tmp_path))
    yield worker, listener
    worker.stop()


@pytest.fixture
def cloudy(tmp_path):
    """A workbench with a recording that has clouds, the first of them shown."""
    with shown(cloudy_session(tmp_path)) as workbench:
        eventually(lambda: workbench.stage.cloud.points.visible)
        yield workbench
