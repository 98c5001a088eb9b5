"""Tuning: settings and limits change, what holds is shown, and the frame shown follows if that is wanted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from handtrack.session.session_state import Edit
from handtrack_app.engine.document import Document
from handtrack_app.engine.document_snapshots import session_snapshot
from handtrack_app.engine.job_control import JobControl
from handtrack_app.engine.posing.pose_service import MakeEdit
from handtrack_app.engine.store import edits, saving
from handtrack_app.engine.store.persistence import Persistence
from handtrack_app.engine.tuning.refit import Refits, Refitted
from handtrack_app.protocol.calls import command
from handtrack_app.protocol.snapshots import Notice, Snapshot


@dataclass
class TuningService:
    """Lives on the worker's thread."""

    document: Document
    store: Persistence
    jobs: JobControl
    edit: MakeEdit
    publish: Callable[[Snapshot], None]
    show: Callable[[], None]
    """shows all again"""
    post: Callable[[Refitted], None]
    """takes what another thread fitted to `serve`"""

    def __post_init__(self) -> None:
        self._refits = Refits(self.document, self.post)

    @command(edits=True, files=True, words="saving settings")
    def save_settings(self) -> None:
        """Write the settings that session.toml does not have into it."""
        self.jobs.require_idle()
        said = saving.save_settings(self.store)
        self.publish(Notice("done", "Settings saved", said))
        self.publish(session_snapshot(self.document))

    @command(view=True)
    def refit_while_tuning(self, on: bool) -> None:
        """Whether a changed setting or limit fits the frame shown anew at once."""
        self._refits.on = on

    @command(edits=True, latest=("name",), words="the setting {name}")
    def set_setting(self, name: str, value: object, tag: str = "") -> None:
        """Change a setting by its dotted name. tag: several settings changed at one time have one."""
        document = self.document
        self._change(
            lambda: (
                edits.method(document, value) if name == "method" else edits.setting(name, value)
            ),
            tag or name,
            edits.is_slid(value),
        )

    @command(edits=True, latest=("name",), words="the limits of {name}")
    def set_limits(self, name: str, interval: tuple[float, float] | None, tag: str = "") -> None:
        """Change the interval of a joint parameter [m, rad]; None restores the model's own."""
        self._change(
            lambda: edits.limits(self.document, name, interval),
            tag or f"Limits of {name}",
            interval is not None,
        )

    @command(edits=True, latest=("name",), words="the shape's {name}")
    def set_shape(self, name: str, value: float, tag: str = "") -> None:
        """Set a number of the person's shape [% or mm, as `ShapeNumber` has it]."""
        self._change(lambda: edits.shape(self.document, name, value), tag or "Shape", True)

    def _change(self, edit: Callable[[], Edit], words: str, slid: bool) -> None:
        """Let values hold from now on. slid: by a slider: many changes are one step of undo."""
        document = self.document

        def changed() -> None:
            try:
                self.jobs.require_idle()
                known = document.run.notes
                self.store.do(words, edit(), tag=words, is_stroke=slid)
                self.say_notes(known)
            finally:
                self.publish(session_snapshot(document))  # the page shows what holds
            self.show()

        self.followed(changed)

    def refitted(self, done: Refitted) -> None:
        """Take a frame that was fitted anew."""
        found = None if self.jobs.busy else self._refits.take(done)
        if found is not None:
            frame, edit, tag = found
            self.edit(frame, edit, "Fit", tag, True)

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
