"""A command of handtrack as a program of its own, read line by line: what it says is shown as it comes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence

_ITSELF = "import sys; from handtrack_app.cli import main; sys.exit(main(sys.argv[1:]))"


class Program:
    """A running command."""

    def __init__(
        self,
        args: Sequence[str],
        tell: Callable[[str], None],
        end: Callable[[int], None],
        environment: Mapping[str, str],
    ) -> None:
        """Start it. tell: is called with each line, end: with the exit code, both on a thread of its own; environment: variables beside ours."""
        environment = {
            **os.environ,
            **environment,
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        }
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _ITSELF, *args],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            encoding="utf-8", errors="replace", env=environment, process_group=0 if os.name == "posix" else None,
        )  # fmt: skip
        threading.Thread(target=self._read, args=(tell, end), daemon=True).start()

    def cancel(self) -> None:
        """Interrupt it, as Ctrl-C does: it ends cleanly."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)

    def _read(self, tell: Callable[[str], None], end: Callable[[int], None]) -> None:
        assert self._process.stdout is not None
        with self._process:
            for line in self._process.stdout:
                if line.strip():
                    tell(line.strip())
        end(self._process.returncode)
