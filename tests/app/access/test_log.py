"""The log of a running workbench: in a file of its user, and nothing of it on the terminal."""

import asyncio
import logging
import os
import socket
import stat
import warnings
from pathlib import Path
from types import SimpleNamespace

import pytest

from handtrack_app.log import _A_MINUTE, LOG_FILE, logging_to
from tests.app.waiting import eventually


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "logs" / "workbench.log"
    with logging_to(path):
        yield path


def test_a17_the_log_is_the_users_own_and_in_his_folder(log):
    logging.getLogger("handtrack_app.test").warning("odd")
    assert "handtrack_app.test WARNING odd" in log.read_text()
    if os.name == "posix":
        assert stat.S_IMODE(log.stat().st_mode) == 0o600
    assert Path(os.environ["HANDTRACK_HOME"]) in LOG_FILE.parents


def test_a17_a_log_that_others_could_read_is_closed_to_them(tmp_path):
    path = tmp_path / "workbench.log"
    path.write_text("old\n")
    path.chmod(0o644)
    with logging_to(path):
        logging.getLogger("handtrack_app.test").warning("odd")
    assert path.read_text().startswith("old\n")
    if os.name == "posix":
        assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_a11_what_asyncio_viser_and_warnings_tell_goes_there(log, capfd):
    async def forgotten():
        asyncio.get_running_loop().call_exception_handler({"message": "a task failed"})

    asyncio.run(forgotten())
    logging.getLogger("some.library").error("odd")
    warnings.warn("queued on a closed connection", stacklevel=1)
    found = log.read_text()
    assert all(words in found for words in ("a task failed", "some.library ERROR odd", "queued on"))
    assert capfd.readouterr().err == ""


def test_a11_a_flood_of_records_is_cut(log, monkeypatch):
    for minute in (1, 2):
        clock = SimpleNamespace(monotonic=lambda minute=minute: 60.0 * minute)
        monkeypatch.setattr("handtrack_app.log.time", clock)
        for k in range(10 * _A_MINUTE):
            logging.getLogger("flooded").warning("%d", k)
        lines = log.read_text().splitlines()
        assert len(lines) == minute * _A_MINUTE
        assert lines[-1].endswith("minute)")


def test_a_request_that_is_no_browsers_is_kept_there(log, small, capfd, monkeypatch):
    # once it has served a page, viser itself keeps such records from every log of the process
    monkeypatch.setattr(logging.getLogger("websockets.server"), "filters", [])
    with socket.create_connection(("127.0.0.1", small.web.port)) as wire:
        wire.sendall(b"HEAD / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        while wire.recv(4096):
            pass
    eventually(lambda: log.is_file() and "unsupported HTTP method" in log.read_text())
    assert "Traceback" not in capfd.readouterr().err
