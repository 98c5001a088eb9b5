"""Where recordings are tracked: so many at once on this machine, or on a dask cluster."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any
from uuid import uuid4

from handtrack.errors import HandtrackError
from handtrack.parallel import thread_count
from handtrack_app.commands.batch.one import track_one
from handtrack_app.commands.batch.outcome import FAILED, STARTED, Outcome
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

    Once it is to stop, the workers stop what they track, as this machine's processes do, and begin nothing more.

    Raises HandtrackError where dask.distributed is not installed, or nobody answers at the address.
    """
    client = _client(address)
    stop = _Asked(f"handtrack-stop-{uuid4()}")
    try:
        left = {
            client.submit(_tracked, one, work, stop, key=f"{one.name}-{one.digest}", pure=False, retries=_RETRIES): one
            for one in todo
        }  # fmt: skip
        asked = False
        while left:
            if should_stop() and not asked:
                asked = True
                stop.ask()
            done = [future for future in left if future.done()]
            yield from filter(None, (_ended(future, left.pop(future)) for future in done))
            if not done:
                threading.Event().wait(_POLL_S)
    finally:
        client.close()


def _tracked(one: Recording, work: Work, should_stop: Callable[[], bool]) -> Outcome | None:
    """Return how a recording's tracking ended, of which a worker has its turn; None where nothing is to be begun any more."""
    if should_stop():
        return None
    return track_one(one, work.words, work.out, work.threads, should_stop)


@dataclass(frozen=True)
class _Asked:
    """Whether those that work somewhere else are to stop: a word of dask's, which all of a cluster hear."""

    name: str

    def ask(self) -> None:
        """Let all workers know."""
        import_module("dask.distributed").Event(self.name).set()

    def __call__(self) -> bool:
        return bool(import_module("dask.distributed").Event(self.name).is_set())


def _ended(future: Any, one: Recording) -> Outcome | None:
    """Return the outcome of a recording; a failed one where its worker was lost too often, or cannot run handtrack."""
    error = "it was cancelled" if future.cancelled() else future.exception()
    if error is None:
        return future.result()
    cause = f"dask: {str(error) or type(error).__name__}"
    ended = datetime.now(UTC).isoformat(timespec="seconds")
    return Outcome(one.name, str(one.folder), one.digest, FAILED, cause=cause, ended=ended)


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
