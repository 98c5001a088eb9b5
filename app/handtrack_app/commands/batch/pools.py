"""Where recordings are tracked: so many at once on this machine, or on a dask cluster."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from handtrack.errors import HandtrackError
from handtrack.parallel import thread_count
from handtrack_app.commands.batch.one import track_one
from handtrack_app.commands.batch.outcome import STARTED, Outcome
from handtrack_app.commands.batch.plan import Recording

_POLL_S = 0.5
_RETRIES = 2
"""of a recording whose dask worker was lost"""


@dataclass(frozen=True)
class Work:
    """What every recording of a batch is tracked with."""

    words: Sequence[str]
    """options of `handtrack track`"""
    out: Path
    threads: int
    """of each process"""


def on_this_machine(
    todo: Sequence[Recording],
    work: Work,
    jobs: int,
    should_stop: Callable[[], bool],
    tell: Callable[[Outcome], None],
) -> Iterator[Outcome]:
    """Yield outcomes as they come, `jobs` recordings at a time. tell: is told that one is begun.

    Once it is to stop, those that run are stopped, and the others not begun.
    """
    over = threading.Event()

    def stopped() -> bool:
        return over.is_set() or should_stop()

    def track(recording: Recording) -> Outcome | None:
        if stopped():
            return None
        tell(Outcome(recording.name, str(recording.folder), recording.digest, STARTED))
        return track_one(recording, work.words, work.out, work.threads, stopped)

    with ThreadPoolExecutor(jobs, "batch") as pool:
        waiting: set[Future[Outcome | None]] = {pool.submit(track, one) for one in todo}
        try:
            while waiting:
                done, waiting = wait(waiting, _POLL_S, FIRST_COMPLETED)
                yield from filter(None, (future.result() for future in done))
        finally:
            over.set()


def on_dask(
    address: str, todo: Sequence[Recording], work: Work, should_stop: Callable[[], bool]
) -> Iterator[Outcome]:
    """Yield outcomes as they come from a dask cluster, whose workers see the same folders and have handtrack installed.

    Raises HandtrackError where dask.distributed is not installed, or nobody answers at the address.
    """
    client = _client(address)
    try:
        futures = [
            client.submit(track_one, one, work.words, work.out, work.threads, key=f"{one.name}-{one.digest}", pure=False, retries=_RETRIES)
            for one in todo
        ]  # fmt: skip
        left = set(futures)
        while left and not should_stop():
            done = {future for future in left if future.done()}
            left -= done
            yield from (future.result() for future in done)
            if not done:
                threading.Event().wait(_POLL_S)
        client.cancel(list(left))
    finally:
        client.close()


def _client(address: str) -> Any:
    try:
        client = import_module("dask.distributed").Client
    except ImportError:
        raise HandtrackError(
            "--dask: dask.distributed is not installed: `pip install distributed`, or handtrack with the extra `cluster`. "
            "--jobs N works without it, on this machine."
        ) from None
    try:
        return client(address, timeout=20)
    except (OSError, TimeoutError, ValueError) as error:
        raise HandtrackError(
            f"--dask {address}: no scheduler answers there ({error}); expected an address as `dask scheduler` prints it, such "
            "as tcp://node1:8786."
        ) from None


def threads_each(jobs: int) -> int:
    """Return how many threads each of so many processes may use, so that together they fill the machine's cores."""
    return max(thread_count() // jobs, 1)
