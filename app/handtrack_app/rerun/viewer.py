"""RerunViewer: rerun's own viewer program, serving its page on loopback only."""

from __future__ import annotations

import atexit
import socket
import subprocess
import sys
import time
from pathlib import Path
from urllib.parse import quote

LOOPBACK = "127.0.0.1"
_STARTING_S = 30.0
_MEMORY = "500MB"


class RerunViewer:
    """A viewer in a process of its own, because rerun cannot serve on loopback from inside this one."""

    def __init__(self) -> None:
        self._data_port, self._page_port = free_ports(2)
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def address(self) -> str:
        """Where recordings connect."""
        return f"rerun+http://{LOOPBACK}:{self._data_port}/proxy"

    @property
    def page(self) -> str:
        """The viewer's page, showing what is sent to `address`."""
        return f"http://{LOOPBACK}:{self._page_port}/?url={quote(self.address, safe='')}"

    def start(self) -> None:
        """Start the viewer and wait until it takes connections. RuntimeError when it does not."""
        command = [*_program(), "--serve-web", "--bind", LOOPBACK]
        command += ["--port", str(self._data_port), "--web-viewer-port", str(self._page_port)]
        command += ["--server-memory-limit", _MEMORY]
        quiet = subprocess.DEVNULL
        self._process = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet)
        atexit.register(self.stop)
        deadline = time.monotonic() + _STARTING_S
        while time.monotonic() < deadline:
            if self._process.poll() is not None:
                raise RuntimeError(
                    f"rerun's viewer ended at once, with code {self._process.returncode}"
                )
            if all(_listens(port) for port in (self._data_port, self._page_port)):
                return
            time.sleep(0.1)
        raise RuntimeError(f"rerun's viewer did not answer within {_STARTING_S:.0f} s")

    def stop(self) -> None:
        """End the viewer."""
        atexit.unregister(self.stop)
        if self._process is None or self._process.poll() is not None:
            return
        self._process.terminate()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _program() -> list[str]:
    """Return the command of rerun's viewer, without the Python around it that would outlive `stop`."""
    import rerun_cli

    name = "rerun.exe" if sys.platform == "win32" else "rerun"
    program = Path(str(rerun_cli.__file__)).parent / name
    return [str(program)] if program.is_file() else [sys.executable, "-m", "rerun"]


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(0.5)
        return probe.connect_ex((LOOPBACK, port)) == 0


def free_ports(count: int) -> list[int]:
    """Return different free ports of loopback."""
    probes = [socket.socket() for _ in range(count)]
    try:
        for probe in probes:
            probe.bind((LOOPBACK, 0))
        return [probe.getsockname()[1] for probe in probes]
    finally:
        for probe in probes:
            probe.close()
