"""Refit while tuning: each change of a setting or limit fits the frame shown anew, on a thread of its own; the newest wins."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats, P, S
from handtrack.errors import HandtrackError, not_enough_memory
from handtrack.session.posed_frames import solver_params_of
from handtrack.session.run import TrackingRun
from handtrack.session.session_state import Edit
from handtrack.tracking.pulling import fitted_again
from handtrack_app.engine.document import Document
from handtrack_app.engine.store.edits import set_pose

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


@dataclass(frozen=True, eq=False)
class Refitted:
    """A frame is fitted anew, or why it could not be."""

    order: _Order
    params: Floats[P] | None
    error: str = ""


@dataclass
class Refits:
    """Asked on the worker's thread; answers go to `post`, and from there to `take`."""

    document: Document
    post: Callable[[Refitted], None]
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

    def take(self, done: Refitted) -> tuple[int, Edit, str] | None:
        """Return the frame, what the fit changes, and its tag; None where it is not of what is shown and holds now. Raises
        HandtrackError where it could not be fitted.
        """
        order, document = done.order, self.document
        if order is not self._newest:
            return None
        self._newest = None
        if done.error:
            raise HandtrackError(done.error)
        here = (order.run, order.frame) == (document.run, document.frame)
        if done.params is None or not here or not np.array_equal(order.stood, document.shown):
            return None
        pinned = bool(document.run.session.pins.of(order.frame))  # they were among what was fitted
        values = document.model.joint_params(done.params)
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
                self.post(self._fitted(order))

    def _fitted(self, order: _Order) -> Refitted:
        run = order.run
        try:
            params = solver_params_of(run.model, order.stood)
            seen = run.observation(order.frame, run.model.bones(params))
            stop = lambda: self._newest is not order  # noqa: E731
            return Refitted(order, fitted_again(run.model, run.settings, seen, params, stop))
        except HandtrackError as error:
            return Refitted(order, None, str(error))
        except MemoryError as error:
            return Refitted(order, None, str(not_enough_memory("Refitting", error)))
        except Exception as error:  # the page must go on, and the user must know
            log.exception("refitting failed")
            return Refitted(order, None, f"Refitting failed ({type(error).__name__}: {error}).")
