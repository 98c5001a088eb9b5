"""`handtrack open` as a program of its own, on its own copy of the bundled recording or on another: its address, memory, output."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from handtrack import HandtrackError

_OPENING_S = 180.0
_ADDRESS = re.compile(r"is open at (\S+)")


class RunningWorkbench:
    """A started workbench; its terminal is a file."""

    def __init__(self, *folder: str) -> None:
        """folder: of a session; without, the bundled one."""
        self._folder = folder

    def __enter__(self) -> RunningWorkbench:
        self._home = tempfile.TemporaryDirectory()
        home = Path(self._home.name)
        self._terminal = (home / "terminal").open("w+")
        command = "import sys; from handtrack_app.cli import main; sys.exit(main(sys.argv[1:]))"
        self._process = subprocess.Popen(
            [sys.executable, "-c", command, "open", "--no-browser", *self._folder],
            env=os.environ | {"HANDTRACK_HOME": str(home)},
            stdout=self._terminal, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        self.url = self._address()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        try:
            self._process.wait(30.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._terminal.close()
        self._home.cleanup()

    def terminal(self) -> str:
        """Return all that was printed so far."""
        return Path(self._terminal.name).read_text("utf-8", errors="replace")

    def resident_mb(self) -> float:
        """Return the resident memory of the program and the processes that it started [MB]; on Linux only."""
        return sum(resident_mb(pid) for pid in self._pids())

    def page_mb(self) -> float:
        """Return the resident memory of the process that serves the page [MB]; on Linux only."""
        return resident_mb(self._process.pid)

    def cpu_s(self) -> float:
        """Return the processor time of the program and the processes that it started [s]; on Linux only."""
        return sum(_ticks(pid) for pid in self._pids()) / os.sysconf("SC_CLK_TCK")

    def open_files(self) -> int:
        """Return its open files and sockets; on Linux only."""
        return sum(len(list(Path(f"/proc/{pid}/fd").iterdir())) for pid in self._pids())

    def threads(self) -> int:
        """Return its threads; on Linux only."""
        return sum(len(list(Path(f"/proc/{pid}/task").iterdir())) for pid in self._pids())

    def _pids(self) -> list[int]:
        """Return the processes of its session."""
        own = self._process.pid
        return [
            int(path.name)
            for path in Path("/proc").iterdir()
            if path.name.isdecimal() and _session(path) == own
        ]

    def _address(self) -> str:
        until = time.monotonic() + _OPENING_S
        while time.monotonic() < until and self._process.poll() is None:
            found = _ADDRESS.search(self.terminal())
            if found:
                return found[1]
            time.sleep(0.1)
        raise HandtrackError(f"the workbench did not open: {self.terminal()[-2000:]}")


def _session(process: Path) -> int | None:
    """Return the id of a process's session; None where it has ended."""
    try:
        return int((process / "stat").read_text().rpartition(")")[2].split()[3])
    except OSError:
        return None


def _ticks(pid: int) -> float:
    try:
        user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    except OSError:
        return 0.0
    return float(user) + float(system)


def resident_mb(pid: int | str) -> float:
    """Return the resident memory of a process [MB]; on Linux only, else 0. pid: or "self"."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0.0
    found = re.search(r"VmRSS:\s+(\d+) kB", status)
    return float(found[1]) / 1000 if found else 0.0
