"""Programs that are killed, or whose disk is full, at random moments: what tests of crash safety share."""

import errno
import json
import os
import random
import select
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

KILLS = int(os.environ.get("HANDTRACK_KILLS", "15"))
forked = pytest.mark.skipif(
    not hasattr(os, "fork"), reason="processes are copied where they can be"
)
Tell = Callable[..., None]
"""tells the test a line of JSON: what is about to be done, or was"""


class Fate:
    """Once it is armed, a write is torn by the program's death, or fails on a full disk; or the program dies any time."""

    def __init__(self, rng: random.Random, write: Callable[[int, bytes], int]) -> None:
        self._rng, self._write, self._left = rng, write, 0
        self._way = rng.choice(("half a write", "full", "any time"))

    def arm(self) -> None:
        """Let it come within 60 writes."""
        self._left = self._rng.randint(1, 60)

    def write(self, handle: int, data: bytes) -> int:
        """Take the place of os.write."""
        self._left -= 1
        if self._left == 0 and self._way != "any time":
            self._write(handle, bytes(data)[: self._rng.randrange(len(data))])
            if self._way == "full":
                self._left = self._rng.randint(1, 20)
                raise OSError(errno.ENOSPC, "No space left on device")
            os.kill(os.getpid(), signal.SIGKILL)
        return self._write(handle, data)


Work = Callable[[Path, Tell, random.Random, Fate], None]
"""works in a folder without end; arms its fate when it begins in earnest"""


def killed(folder: Path, rng: random.Random, work: Work, longest_s: float) -> list[list[Any]]:
    """Let a child work until it kills itself, or is killed within so long of its first word; return what it told."""
    hear, tell = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(hear)
            signal.alarm(60)
            really_write = os.write
            fate = Fate(rng, really_write)
            os.write = fate.write
            work(
                folder,
                lambda *line: really_write(tell, (json.dumps(line) + "\n").encode()),
                rng,
                fate,
            )
        except BaseException as error:
            os.write(2, f"the child ended by {error!r}\n".encode())
        finally:
            os._exit(1)
    os.close(tell)
    if rng.random() < 0.8:  # else it may be opening the store still
        select.select([hear], [], [], 30.0)
    time.sleep(rng.uniform(0.0, longest_s))
    os.kill(child, signal.SIGKILL)
    status = os.waitpid(child, 0)[1]
    assert os.waitstatus_to_exitcode(status) == -signal.SIGKILL, "it ended by itself"
    with os.fdopen(hear) as lines:
        return [json.loads(line) for line in lines if line.endswith("\n")]
