"""A started process for the engine, as the one that started it sees it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, cast

from handtrack_app.process.channel import Channel, FromEngine

_GOING_S = 2.0  # between the end of its pipe and its own
_LARGEST_LOG = 1_000_000  # bytes; a larger one makes room when an engine begins
_PROGRAM = "handtrack_app.process.child"


class EngineChild:
    """Begins to import what the engine needs at once; its plan may come later."""

    def __init__(self, log: Path) -> None:
        """Start it. log: takes what it prints, its tracebacks and those of crashes."""
        # -P: nothing is imported from the folder that the user happens to be in, unless this process does
        command = [sys.executable, "-P", "-m", _PROGRAM]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        self.log_from = 0
        """where in the log its own words begin [bytes]"""
        try:
            log.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            if log.is_file() and log.stat().st_size > _LARGEST_LOG:
                log.replace(log.with_name(f"{log.name}.1"))
            errors = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
            self.log_from = os.fstat(errors).st_size
        except OSError:  # another user's file
            errors = os.open(os.devnull, os.O_WRONLY)
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                env=environment,
                # in a group of its own, Ctrl-C reaches the page's process only, and what it starts can be ended with it
                process_group=0 if os.name == "posix" else None,
            )
        finally:
            os.close(errors)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._channel = Channel(cast("BinaryIO", self._process.stdout), self._process.stdin)  # type: ignore[arg-type]
        self.pid = self._process.pid
        self._ended = False

    def send(self, message: object) -> bool:
        """Hand over a message, waiting while the pipe is full; return whether it still takes any."""
        try:
            self._channel.send(message)
        except (OSError, ValueError):  # closed
            return False
        return True

    def listen(self, take: Callable[[FromEngine], None]) -> int:
        """Hand over its messages as they come, until it ended; return its exit code, or the signal's number below 0."""
        while True:
            try:
                message = self._channel.receive()
            except EOFError:
                break
            take(message)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_GOING_S)
        self.kill()
        return self._process.returncode

    def kill(self) -> None:
        """End it at once, and what it started. Until its end was waited for, its lease would look alive."""
        if self._ended:
            return
        self._ended = True  # its number may be another's from now on
        if os.name == "posix":
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, signal.SIGKILL)
        else:
            self._process.kill()
        self._process.wait()
        self._channel.close()
