"""A worker and all that it says, on a fake run too; and a workbench."""

import pickle
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, cast

from handtrack_app import protocol
from handtrack_app.engine.document import Document
from handtrack_app.engine.open_session import COMMANDS
from handtrack_app.engine.worker import Worker
from handtrack_app.page.page import UserState
from handtrack_app.process.child import EnginePlan
from handtrack_app.protocol import Call, Caller, Engine
from handtrack_app.workbench import Workbench
from tests.app.fake_run import fake_document


class Listener:
    """Keeps every snapshot, pickled and unpickled as a process would get it."""

    def __init__(self) -> None:
        self.seen: list[protocol.Snapshot] = []
        self._came = threading.Condition()

    def publish(self, snapshot: protocol.Snapshot) -> None:
        copy = pickle.loads(pickle.dumps(snapshot))
        with self._came:
            self.seen.append(copy)
            self._came.notify_all()

    def wait(self, kind: type, test: Callable[[Any], bool] = lambda _: True, after: int = 0) -> Any:
        """Return the first snapshot of a kind that passes the test, waiting for it. after: so many that came before."""

        def find() -> Any:
            found = self.seen[after:]
            return next((s for s in found if isinstance(s, kind) and test(s)), None)

        with self._came:
            assert self._came.wait_for(lambda: find() is not None, 600.0), (
                f"no {kind.__name__} came"
            )
            return find()

    @property
    def notices(self) -> list[protocol.Notice]:
        return [s for s in self.seen if isinstance(s, protocol.Notice)]

    def pose(self, version: int) -> protocol.PoseSnapshot:
        return self.wait(protocol.PoseSnapshot, lambda p: p.version == version)

    def told(self, words: str, after: int = 0) -> protocol.Notice:
        return self.wait(protocol.Notice, lambda n: words in f"{n.title}: {n.text}", after)

    def refused(self) -> protocol.Notice:
        return self.wait(protocol.Notice, lambda n: n.level == "error")


class EngineInThreads(Worker):
    """The engine on threads of this process, with the face of EngineProcess: quickly started, and its document can be looked at."""

    def __init__(self, plan: EnginePlan, publish: Callable[[protocol.Snapshot], None]) -> None:
        super().__init__(plan, self._record)
        self._publish_on = publish
        self._opened = {is_whole: threading.Event() for is_whole in (False, True)}
        self._why: Exception | None = None
        self.engine = cast("Engine", Caller(lambda *asked: self.send(Call.of(COMMANDS, *asked))))

    def _record(self, snapshot: protocol.Snapshot) -> None:
        self._publish_on(snapshot)
        if isinstance(snapshot, protocol.Opened):
            self._why = snapshot.failure
            self._opened[snapshot.is_whole].set()

    def stop(self, timeout: float = 600.0) -> None:
        super().stop(600.0)

    def wait_shown(self, timeout: float) -> Exception | None:
        assert self._opened[False].wait(timeout)
        return self._why

    def wait_opened(self, timeout: float) -> Exception | None:
        assert self._opened[True].wait(timeout)
        return self._why

    def start_again(self) -> None: ...

    @property
    def document(self) -> Document:
        assert self.session is not None, "no session is open"
        return self.session.document

    @property
    def busy(self) -> bool:
        return self.session is not None and self.session.jobs.busy


def in_threads(folder: Path, demo: bool = False, **plan: Any) -> Workbench:
    """Return a workbench whose engine is threads of this process, to be started."""
    planned = EnginePlan(folder, **plan)
    engine = cast("Any", partial(EngineInThreads, planned))
    return Workbench(planned, engine, port=0, demo=demo)


def working(folder: Path, opener: Any = None) -> tuple[EngineInThreads, Listener]:
    """Return a worker that has a session open, and all that it says."""
    listener = Listener()
    plan = EnginePlan(folder, opener=opener, preview=False)
    worker = EngineInThreads(plan, listener.publish)
    worker.start()
    listener.wait(protocol.ProgressSnapshot, lambda p: p.state in ("idle", "failed"))
    return worker, listener


def a_desk(folder: Path, **options: Any) -> Iterator[tuple[EngineInThreads, Listener]]:
    worker, listener = working(folder, lambda f: fake_document(f, **options))
    yield worker, listener
    worker.stop()


@contextmanager
def shown(folder: Path, **options: Any) -> Iterator[Workbench]:
    """Show a session in a workbench."""
    bench = in_threads(folder, **options).start()
    try:
        assert bench.wait_ready(600.0)
        yield bench
    finally:
        bench.stop()


def pose_with(listener: Listener, **changes: float) -> tuple[float, ...]:
    session, pose = listener.wait(protocol.SessionSnapshot), listener.wait(protocol.PoseSnapshot)
    values = dict(zip(session.parameter_names, pose.values, strict=True)) | changes
    return tuple(float(v) for v in values.values())


def value_of(state: UserState, name: str) -> float:
    """Return a joint parameter as the user last set or saw it [m, rad]."""
    return dict(zip(state.names, state.values, strict=True))[name]
