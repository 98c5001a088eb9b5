"""Tuning: settings and limits change, what holds is shown, and the frame shown follows if that is wanted."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.model.size import with_number
from handtrack.session.session_state import Edit, decide
from handtrack.tracking.frame.settings import SETTINGS
from handtrack.tracking.pulling import fitted_again
from handtrack_app.engine import edits
from handtrack_app.engine.posing_service import set_pose
from handtrack_app.engine.service import NewestFirst, Service
from handtrack_app.protocol import Command, FileKind, Notice

if TYPE_CHECKING:
    from handtrack_app.engine.open_session import OpenSession


class TuningService(Service):
    """Settings and limits."""

    def __init__(self, opened: OpenSession) -> None:
        super().__init__(opened)
        self._refits = False
        """whether a changed setting or limit fits the frame shown anew"""
        self._order: object | None = None
        """of the newest fit; any other is given up at its next solver step"""
        self._fitting = NewestFirst[Callable[[], None]](opened.post, "refitting")

    @Command(edits=True, files=True, tunes=True)
    def save_to_file(self, kind: FileKind) -> None:
        """Write what session.toml does not have of a kind into it."""
        self.publish(Notice("done", "Settings saved", self.store.save_settings(kind)))

    @Command(edits=True, tunes=True)
    def restore_from_file(self, kind: FileKind) -> None:
        """Go back to what session.toml has of a kind."""
        back = dict.fromkeys(self.document.unsaved(kind))
        edit = decide(clouds=None) if kind == "clouds" else decide(**{kind: back})
        self.store.do("Settings of session.toml", edit)

    @Command(view=True)
    def refit_while_tuning(self, on: bool) -> None:
        """Whether a changed setting or limit fits the frame shown anew at once."""
        self._refits = on

    @Command(edits=True, latest=("name",), tunes=True)
    def set_setting(self, name: str, value: object, tag: str = "") -> None:
        """Change a setting by its dotted name. tag: several settings changed at one time have one."""
        edit = decide(setting={name: value})
        if name == "method":
            edit = edits.method(self.document, value)
        self._change(edit, tag or name, edits.is_slid(value))

    @Command(edits=True, latest=("name",), tunes=True)
    def set_limits(self, name: str, interval: tuple[float, float] | None, tag: str = "") -> None:
        """Change the interval of a joint parameter [m, rad]; None restores the model's own."""
        low_high = None if interval is None else tuple(sorted(interval))
        edit = decide(limits={name: low_high})
        self._change(edit, tag or f"Limits of {name}", interval is not None)

    @Command(edits=True, latest=("name",), tunes=True)
    def set_shape(self, name: str, value: float, tag: str = "") -> None:
        """Set a number of the person's shape [% or mm, as `ShapeNumber` has it]."""
        scale = with_number(self.document.model, name, value)
        self._change(edits.size(scale), tag or "Shape", True)

    def _change(self, edit: Edit, words: str, slid: bool) -> None:
        """Let values hold from now on. slid: by a slider: many changes are one step of undo."""
        known = self.document.run.notes
        self.store.do(words, edit, words, is_stroke=slid)
        self.publish_notes(known)

    def fit_again(self) -> None:
        """What is tracked by has changed: have the frame shown fitted anew, if that is wanted. Raises HandtrackError for an accepted frame,
        which no fit changes.
        """
        document = self.document
        if not self._refits or document.session.live is not None:
            return
        document.refuse_to_fit(document.frame)
        run, frame, stood, tag = document.run, document.frame, document.shown.copy(), self.store.tag
        self._order = order = object()

        def fit() -> Callable[[], None]:
            """Fit beside the worker; return what the worker is to do with that, or with what went wrong."""
            result: Floats[P] | Exception | None
            try:
                begun = run.model.params_within_limits(stood)
                observed = run.observation(frame, run.model.bones(begun))
                stop = lambda: self._order is not order  # noqa: E731
                result = fitted_again(run.model, run.settings, observed, begun, stop)
            except Exception as error:  # the page must go on, and the user must know
                result = error
            return lambda: take(result)

        def take(result: Floats[P] | Exception | None) -> None:
            """Take the frame, unless it is not of what is shown and holds now. Raises what kept it from being fitted."""
            if self.jobs.busy or self._order is not order:
                return
            self._order = None
            if isinstance(result, Exception):
                raise result
            is_here = (run, frame) == (document.run, document.frame)
            if result is None or not is_here or not np.array_equal(stood, document.shown):
                return
            pinned = bool(document.session.pins.of(frame))  # they were among what was fitted
            values = document.model.joint_params(result)
            edit = set_pose(document, frame, values, refitted=True, pinned=pinned)
            self.opened.edit(frame, edit, "Fit", tag, True)

        self._fitting.ask("refit", fit)

    def cancel(self) -> None:
        """Let the latest change stand without a fit."""
        self._order = None

    def close(self) -> None:
        """End what is still fitted, at its next solver step."""
        self._order = None
        self._fitting.stop()

    def publish_notes(self, known: Sequence[str] = ()) -> None:
        """Say which settings have no effect here, unless these are known; or that there are none of them any more."""
        notes, title = self.document.run.notes, "About the settings"
        if notes and notes != known:
            self.publish(Notice("warning", title, _NAME.sub(_label, " ".join(notes))))
        elif known and not notes:
            self.publish(Notice("done", title, "All that were changed have an effect."))


_NAME = re.compile(r"\b[a-z]+\.[a-z_]+\b")


def _label(name: re.Match[str]) -> str:
    """Return a setting's name as the page has it; that of session.toml where the page has none."""
    known = SETTINGS.get(name[0])
    return f"“{known.label}”" if known is not None and known.label else name[0]
