"""Tuning: settings and limits change, what holds is shown, and the frame shown follows if that is wanted."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from handtrack.arrays import Floats, P, S
from handtrack.errors import HandtrackError, not_enough_memory
from handtrack.session.run import TrackingRun
from handtrack.session.session_state import Edit
from handtrack.tracking.pulling import fitted_again
from handtrack_app.engine.document import Document
from handtrack_app.engine.document_snapshots import session_snapshot
from handtrack_app.engine.posing_service import set_pose
from handtrack_app.engine.service import Service
from handtrack_app.engine.store import edits, saving
from handtrack_app.protocol.calls import command
from handtrack_app.protocol.snapshots import Notice

if TYPE_CHECKING:
    from handtrack_app.engine.open_session import OpenSession

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class _Order:
    """A frame to be fitted, and all that it goes by."""

    run: TrackingRun
    frame: int
    stood: Floats[S]
    """the pose that it begins with"""
    tag: str
    """of the control that was moved"""


@dataclass
class Refits:
    """Asked on the worker's thread; answers go to `post`, and from there to `take`."""

    document: Document
    post: Callable[[_Order, Floats[P] | None, str], None]
    """takes an order, the solver parameters that fit, and why there are none"""
    on: bool = False

    def __post_init__(self) -> None:
        self._waits = threading.Condition()
        self._newest: _Order | None = None
        self._thread: threading.Thread | None = None
        self._closed = False

    def ask(self, tag: str) -> None:
        """Have the frame shown fitted anew from where it stands, if that is wanted. Raises HandtrackError for one that is
        accepted.
        """
        document = self.document
        if not self.on or document.run.session.live is not None:
            return
        document.refuse_to_fit(document.frame)
        order = _Order(document.run, document.frame, document.shown.copy(), tag)
        with self._waits:
            self._newest = order
            self._waits.notify()
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="refitting", daemon=True)
            self._thread.start()

    def cancel(self) -> None:
        """Let the latest change stand without a fit."""
        with self._waits:
            self._newest = None

    def close(self) -> None:
        """End the thread at its next solver step."""
        with self._waits:
            self._newest, self._closed = None, True
            self._waits.notify()

    def take(
        self, order: _Order, params: Floats[P] | None, error: str
    ) -> tuple[int, Edit, str] | None:
        """Return the frame, what the fit changes, and its tag; None where it is not of what is shown and holds now. Raises
        HandtrackError where it could not be fitted.
        """
        document = self.document
        if order is not self._newest:
            return None
        self._newest = None
        if error:
            raise HandtrackError(error)
        here = (order.run, order.frame) == (document.run, document.frame)
        if params is None or not here or not np.array_equal(order.stood, document.shown):
            return None
        pinned = bool(document.run.session.pins.of(order.frame))  # they were among what was fitted
        values = document.model.joint_params(params)
        edit = set_pose(document, order.frame, values, refitted=True, pinned=pinned)
        return order.frame, edit, order.tag

    # ---- on its own thread

    def _work(self) -> None:
        done: _Order | None = None
        while True:
            with self._waits:
                self._waits.wait_for(lambda done=done: self._closed or self._newest is not done)
                if self._closed:
                    return
                order = done = self._newest
            if order is not None:
                self.post(order, *self._fitted(order))

    def _fitted(self, order: _Order) -> tuple[Floats[P] | None, str]:
        run = order.run
        try:
            params = run.model.params_within_limits(order.stood)
            seen = run.observation(order.frame, run.model.bones(params))
            stop = lambda: self._newest is not order  # noqa: E731
            return fitted_again(run.model, run.settings, seen, params, stop), ""
        except HandtrackError as error:
            return None, str(error)
        except MemoryError as error:
            return None, str(not_enough_memory("Refitting", error))
        except Exception as error:  # the page must go on, and the user must know
            log.exception("refitting failed")
            return None, f"Refitting failed ({type(error).__name__}: {error})."


class TuningService(Service):
    """Settings and limits."""

    def __init__(self, opened: OpenSession) -> None:
        super().__init__(opened)
        self._refits = Refits(
            self.document, lambda *done: opened.post(partial(self._refitted, *done))
        )

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
            self.opened.show_all()

        self.followed(changed)

    def _refitted(self, order: _Order, params: Floats[P] | None, error: str) -> None:
        """Take a frame that was fitted anew."""
        found = None if self.jobs.busy else self._refits.take(order, params, error)
        if found is not None:
            frame, edit, tag = found
            self.opened.edit(frame, edit, "Fit", tag, True)

    def followed(self, change: Callable[[], object]) -> None:
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
