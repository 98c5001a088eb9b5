"""A worker and all that it says, on a fake run too; and a workbench."""

import pickle
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from handtrack_app.engine.opening import Opening
from handtrack_app.engine.worker import Worker
from handtrack_app.process.child import EnginePlan
from handtrack_app.protocol import snapshots
from handtrack_app.workbench import Workbench
from tests.app.fake_run import fake_document


class Listener:
    """Keeps every snapshot, pickled and unpickled as a process would get it."""

    def __init__(self) -> None:
        self.seen: list[snapshots.Snapshot] = []
        self._came = threading.Condition()

    def publish(self, snapshot: snapshots.Snapshot) -> None:
        copy = pickle.loads(pickle.dumps(snapshot))
        with self._came:
            self.seen.append(copy)
            self._came.notify_all()

    def wait(
        self, kind: type, test: Callable[[Any], bool] = lambda _: True, timeout: float = 60.0
    ) -> Any:
        """Return the first snapshot of a kind that passes the test, waiting for it."""

        def find() -> Any:
            return next((s for s in list(self.seen) if isinstance(s, kind) and test(s)), None)

        with self._came:
            assert self._came.wait_for(lambda: find() is not None, timeout), (
                f"no {kind.__name__} came"
            )
            return find()

    def pose(self, version: int) -> snapshots.PoseSnapshot:
        return self.wait(snapshots.PoseSnapshot, lambda p: p.version == version)

    def told(self, words: str) -> snapshots.Notice:
        return self.wait(snapshots.Notice, lambda n: words in f"{n.title}: {n.text}")

    def refused(self) -> snapshots.Notice:
        return self.wait(snapshots.Notice, lambda n: n.level == "error")

    def state(self, state: str) -> snapshots.ProgressSnapshot:
        return self.wait(snapshots.ProgressSnapshot, lambda p: p.state == state)


def working(folder: Path, opener: Any = None) -> tuple[Worker, Listener]:
    """Return a worker that has a session open, and all that it says."""
    listener = Listener()
    worker = Worker(EnginePlan(folder, opener=opener or Opening().document), listener.publish)
    worker.start()
    listener.wait(snapshots.ProgressSnapshot, lambda p: p.state in ("idle", "failed"))
    return worker, listener


def a_desk(folder: Path, **options: Any) -> Iterator[tuple[Worker, Listener]]:
    worker, listener = working(folder, lambda f: fake_document(f, **options))
    yield worker, listener
    worker.stop()


@contextmanager
def shown(folder: Path, **options: Any) -> Iterator[Workbench]:
    """Show a session in a workbench."""
    bench = Workbench(folder, port=0, **options).start()
    try:
        assert bench.wait_ready()
        yield bench
    finally:
        bench.stop()


def pose_with(listener: Listener, **changes: float) -> tuple[float, ...]:
    session, pose = listener.wait(snapshots.SessionSnapshot), listener.wait(snapshots.PoseSnapshot)
    values = dict(zip(session.parameter_names, pose.values, strict=True)) | changes
    return tuple(float(v) for v in values.values())
