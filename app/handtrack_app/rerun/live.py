"""Streams what the workbench tracks to rerun's live viewer; tracking never waits for it."""

from __future__ import annotations

import importlib
import threading
from collections.abc import Callable
from typing import Any

from handtrack.tracking.frame.result import FrameResult
from handtrack_app.protocol.messages import Notice, RerunPage


class LiveRecorder:
    """One recording, in a viewer of its own, for each state of hand and settings."""

    def __init__(self, tell: Callable[[Notice | RerunPage], None]) -> None:
        self._tell = tell
        self._run: Any = None
        self._recorder: Any = None
        self._told_problem = False

    def show(self, run: Any, result: FrameResult) -> None:
        """Show one tracked frame. Called on the tracking thread; returns at once."""
        if run is not self._run:
            self._begin(run)
        self._recorder.show(result)
        if self._recorder.problem and not self._told_problem:
            self._told_problem = True
            self._tell(Notice("warning", "Nothing goes to rerun", self._recorder.problem))

    def _begin(self, run: Any) -> None:
        before = self._recorder
        if before is not None:  # it may still have pictures to paint: not on this thread
            threading.Thread(target=before.close, name="rerun-close", daemon=True).start()
        module = importlib.import_module("handtrack_app.rerun.recorder")
        self._run, self._told_problem = run, False
        self._recorder = module.ResidualRecorder(run, live=True)
        self._tell(RerunPage(self._recorder.url))

    def close(self) -> None:
        """End the recording and its viewer."""
        if self._recorder is not None:
            self._recorder.close()
            self._recorder = self._run = None
