"""A take that is being tracked: its frames go to disk as they come, and what cannot is tried again."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from handtrack.arrays import Floats, P
from handtrack.model.articulated import HandScale
from handtrack.session.takes.take_about import refined_by
from handtrack.session.takes.versions import versions_in_use
from handtrack.store.current_track import TakeFrames
from handtrack.store.store import WritableStore
from handtrack.store.take import TakeAbout, TakeWriter
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.whole.refinement import Refinement
from handtrack_app.engine.document import Document

PROGRAM = "handtrack open"


@dataclass
class OpenTake:
    """Its frames are on the document's shelf at once."""

    number: int
    frames: range
    first: int
    """where tracking started: a pose set by hand there gives way to what is tracked"""
    shelf: TakeFrames
    writer: TakeWriter | None
    """None: of a session that keeps nothing"""
    waiting: dict[int, FrameResult] = field(default_factory=dict)
    """frames that could not be written yet"""
    is_refined: bool = False
    scale: HandScale | None = None
    """of the hand, where it is another than the document's"""
    is_shown: bool = False
    is_told: bool = False
    """that frames cannot be written"""

    @classmethod
    def begin(
        cls,
        document: Document,
        store: WritableStore | None,
        frames: range,
        first: int,
        params: Floats[P],
        keyframes: tuple[int, ...] = (),
        is_refined: bool = False,
        shared: Refinement | None = None,
    ) -> OpenTake:
        """Begin a take; tracking starts at frame `first` with solver parameters. is_refined: it is of all frames together;
        shared: what these share. Raises HandtrackError.
        """
        run, scale = document.run, None if shared is None else shared.scale
        labels = (run if scale is None else run.with_scale(scale)).labels
        labels = replace(labels, refinement=None if shared is None else shared.text)
        settings = run.settings.flat()
        shelf = TakeFrames(run.model.parameter_names, {}, labels.refinement, settings)
        about = TakeAbout(
            by=refined_by(PROGRAM) if is_refined else PROGRAM,
            begun=datetime.now(UTC).isoformat(timespec="seconds"),
            frames=(frames.start, frames.stop),
            labels=labels,
            inputs={} if store is None else document.files_read(),
            start={"frame": first, "parameters": params.tolist()},
            keyframes=keyframes,
            versions=versions_in_use(),
        )
        writer = None if store is None else store.begin(about)
        number = document.takes.next_number if writer is None else writer.take.number
        document.takes.put(number, shelf)
        return cls(number, frames, first, shelf, writer, is_refined=is_refined, scale=scale)

    def keep(self, result: FrameResult) -> None:
        """Keep a frame, and those that could not be written before. Raises HandtrackError where they cannot now."""
        self.shelf.put(result, None)
        if self.writer is not None:
            self.waiting[result.frame] = result
            self._write_waiting(self.writer)

    def _write_waiting(self, writer: TakeWriter) -> None:
        for waiting in list(self.waiting.values()):
            self.shelf.put(waiting, writer.replace(waiting))
            del self.waiting[waiting.frame]

    def sync(self) -> None:
        """Bring to disk what was kept. Raises HandtrackError."""
        if self.writer is not None:
            self.writer.sync()

    def end(self, finished: bool) -> None:
        """Say that no frame comes any more; finished: all of them did. Raises HandtrackError for what cannot be written."""
        if self.writer is not None:
            self._write_waiting(self.writer)
            if finished:
                self.writer.finish()
