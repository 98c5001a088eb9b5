"""Pins of the page: pulled at, dropped, copied; the pose follows at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from handtrack.errors import HandtrackError
from handtrack.observation.pins import Pin
from handtrack_app.engine.document import Document
from handtrack_app.engine.posing import pin_edits
from handtrack_app.engine.posing.pin_cards import words_of
from handtrack_app.engine.posing.pin_edits import Pull
from handtrack_app.engine.store.edits import Values
from handtrack_app.protocol.posing import CopyPins, DropPins, SetPin


@dataclass
class PinService:
    """Lives on the worker's thread."""

    document: Document
    edit: Callable[[int, Values, str, str, bool], None]
    """changes a frame's pose, and shows it; at last what is done in words, the control's tag, and whether that is of one drag"""
    _pull: Pull | None = None

    def serve(self, request: SetPin | DropPins | CopyPins) -> None:
        """Do what is asked. Raises HandtrackError."""
        document, frame = self.document, request.frame
        if document.run.session.live is not None:
            raise HandtrackError(
                "Running cameras go on: a pin would be of an image that is gone. Record a session, and correct that."
            )
        match request:
            case SetPin():
                pull = self._pull
                if pull is None or (pull.tag, pull.frame) != (request.tag, frame):
                    pull = self._pull = pin_edits.begun(document, frame, request.tag)
                pin = Pin(request.camera, request.pixel, request.joint, request.bone, request.point)
                placed = pin_edits.placed(document, pull, pin, request.by_images)
                what = f"Pin of {words_of(request.joint or request.bone)} in {request.camera}"
                self.edit(frame, placed, what, request.tag, True)
            case DropPins():
                pull = self._pull = pin_edits.begun(document, frame, "")
                left = pin_edits.dropped(document, pull, request.which, request.by_images)
                self.edit(
                    frame,
                    left,
                    "Pin dropped" if request.which is not None else "Pins dropped",
                    "",
                    False,
                )
            case CopyPins():
                others = range(frame - request.before, frame + request.behind + 1)
                self.edit(
                    frame, pin_edits.copied(document, frame, others), "Pins copied", "", False
                )
