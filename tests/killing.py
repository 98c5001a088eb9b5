"""Programs that are killed, or whose disk is full, at random moments: what tests of crash safety share."""

import errno
import json
import multiprocessing
import os
import random
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from multiprocessing import forkserver
from pathlib import Path
from typing import Any

import pytest

KILLS = int(os.environ.get("HANDTRACK_KILLS", "15"))
forked = pytest.mark.skipif(
    not hasattr(os, "fork"), reason="processes are copied where they can be"
)
Tell = Callable[..., None]
"""tells the test a line of JSON: what is about to be done, or was"""


def copy_of_a_fresh_process(work: Callable[..., object], *arguments: object) -> Any:
    """Begin a function of a module in a copy of a process that never had threads (`warmed`); ten minutes at most.

    A copy of the process that tests run in has none of its threads, but the locks that they held, and it waits for threads that are
    not there: measured, 2 in 25 copies hung in the limit of linear algebra's threads while another thread tracked, 58 of 60 in
    OpenBLAS where that has two threads, and each one that collected a video that was read before.
    """
    process = copies().Process(target=_within_ten_minutes, args=(work, *arguments), daemon=True)
    process.start()
    return process


@cache
def copies() -> Any:
    """Return the context in which processes are copies of one that is warmed."""
    copies = multiprocessing.get_context("forkserver")
    copies.set_forkserver_preload(["tests.warmed"])
    with pytest.MonkeyPatch.context() as patch:  # where this process imports from
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))
        patch.setenv("HANDTRACK_THREADS", "1")
        forkserver.ensure_running()
    return copies


def _within_ten_minutes(work, *arguments):
    signal.alarm(600)
    work(*arguments)


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


def killed(folder: Path, rng: random.Random, work: Work, lines: int) -> list[list[Any]]:
    """Let a child work until it kills itself, or is killed once it told some lines, fewer than so many; return what it told."""
    hear, tell = multiprocessing.Pipe(duplex=False)
    child = copy_of_a_fresh_process(_work_until_killed, folder, rng.random(), work, tell)
    tell.close()
    told = list[list[Any]]()
    enough = rng.randrange(lines) if rng.random() < 0.8 else 0  # it may be opening the store still
    with hear, suppress(EOFError, OSError):  # the last may be torn
        while True:
            if len(told) == enough:
                time.sleep(rng.uniform(0.0, 0.01))
                child.kill()
            told.append(json.loads(hear.recv_bytes()))
    child.join()
    assert child.exitcode == -signal.SIGKILL, "it ended by itself"
    for lease in folder.rglob("lease-*.json"):
        os.utime(lease, (0, 0))  # one that was torn holds for seconds
    return told


def _work_until_killed(folder, seed, work, tell):
    rng, really_write = random.Random(seed), os.write
    fate = Fate(rng, really_write)
    os.write = fate.write
    work(folder, lambda *line: tell.send_bytes(json.dumps(line).encode()), rng, fate)
