"""The engine on threads of this process: a worker by a plan, with its recorder for rerun."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from handtrack_app.engine.document import Document
from handtrack_app.engine.live.live_control import open_live_document
from handtrack_app.engine.opening import Opening
from handtrack_app.engine.worker import Worker
from handtrack_app.process.plan import EnginePlan
from handtrack_app.protocol.snapshots import Snapshot
from handtrack_app.rerun.recorder import LiveRecorder


class EngineThread(Worker):
    """A worker that does what a plan says."""

    def __init__(self, plan: EnginePlan, publish: Callable[[Snapshot], None]) -> None:
        self._recorder = LiveRecorder(publish) if plan.rerun else None
        opening = Opening()
        live = None if plan.live is None else partial(open_live_document, plan.live)
        opener = plan.opener or live

        def opened(folder: Path, overrides: Mapping[str, object]) -> Document:
            document = (opener or opening.document)(folder, overrides)
            document.version = plan.version
            return document

        super().__init__(
            plan.folder,
            publish,
            opened,
            None if self._recorder is None else self._recorder.show,
            opening.preview if opener is None and plan.preview else None,
            plan.take_over,
            plan.page,
        )

    def stop(self, timeout: float = 5.0) -> None:
        """End the threads, then the recorder; the store already has what was saved."""
        super().stop(timeout)
        if self._recorder is not None:
            self._recorder.close()
