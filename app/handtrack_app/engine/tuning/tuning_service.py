"""Tuning: settings and limits change, what holds is shown, and the frame shown follows if that is wanted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from handtrack_app.engine.document import Document
from handtrack_app.engine.document_snapshots import session_snapshot
from handtrack_app.engine.job_control import JobControl
from handtrack_app.engine.posing.pose_service import Edit
from handtrack_app.engine.store import edits, saving
from handtrack_app.engine.store.persistence import Persistence
from handtrack_app.engine.tuning.refit import Refits, Refitted
from handtrack_app.protocol import commands
from handtrack_app.protocol.snapshots import Notice, Snapshot

Request = (
    commands.SetSetting | commands.SetLimits | commands.SetShape | commands.SaveSettings
    | commands.RefitWhileTuning | Refitted
)  # fmt: skip
_Change = commands.SetSetting | commands.SetLimits | commands.SetShape


@dataclass
class TuningService:
    """Lives on the worker's thread."""

    document: Document
    store: Persistence
    jobs: JobControl
    edit: Edit
    publish: Callable[[Snapshot], None]
    show: Callable[[], None]
    """shows all again"""
    post: Callable[[Refitted], None]
    """takes what another thread fitted to `serve`"""

    def __post_init__(self) -> None:
        self._refits = Refits(self.document, self.post)

    def serve(self, request: Request) -> None:
        """Do what is asked. Raises HandtrackError."""
        match request:
            case commands.SaveSettings():
                self.jobs.require_idle()
                said = saving.save_settings(self.store)
                self.publish(Notice("done", "Settings saved", said))
                self.publish(session_snapshot(self.document))
            case commands.RefitWhileTuning():
                self._refits.on = request.on
            case Refitted():
                found = None if self.jobs.busy else self._refits.take(request)
                if found is not None:
                    frame, values, tag = found
                    self.edit(frame, values, "Fit", tag, True)
            case _:
                self._change(request)

    def _change(self, change: _Change) -> None:
        self.followed(lambda: self._changed(change))

    def _changed(self, change: _Change) -> None:
        document = self.document
        try:
            self.jobs.require_idle()
            if isinstance(change, commands.SetLimits):
                values = edits.limits(document, change.name, change.interval)
                slid = change.interval is not None
                words = f"Limits of {change.name}"
            elif isinstance(change, commands.SetShape):
                values, slid = edits.shape(document, change.name, change.value), True
                words = "Shape"
            else:
                name, value = change.name, change.value
                slid = edits.is_slid(value)
                values = (
                    edits.method(document, value)
                    if name == "method"
                    else edits.setting(name, value)
                )
                words = name
            known, words = document.run.notes, change.tag or words
            self.store.do(words, values, tag=words, is_stroke=slid)
            self.say_notes(known)
        finally:
            self.publish(session_snapshot(document))  # the page shows what holds
        self.show()

    def followed(self, change: Callable[[], None]) -> None:
        """Change what is tracked by, and have the frame shown fitted anew if that did. Raises HandtrackError, and for an accepted
        frame, which no fit changes.
        """
        run = self.document.run
        change()
        if self.document.run is not run:
            self._refits.ask(self.store.tag)

    def cancel(self) -> None:
        """Fit no more by the latest change."""
        self._refits.cancel()

    def close(self) -> None:
        """End what is still fitted."""
        self._refits.close()

    def say_notes(self, known: Sequence[str]) -> None:
        """Say what is new to be known of the settings: above all that one has no effect here."""
        for note in self.document.run.notes:
            if note not in known:
                self.publish(Notice("warning", "About the settings", note))
