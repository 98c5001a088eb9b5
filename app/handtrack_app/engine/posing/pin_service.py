"""Pins of the page: pulled at, dropped, copied; the pose follows at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from handtrack.errors import HandtrackError
from handtrack.observation.pins import Pin
from handtrack.session.session_state import Edit
from handtrack_app.engine.document import Document
from handtrack_app.engine.job_control import drags, looks_elsewhere
from handtrack_app.engine.posing import pin_edits
from handtrack_app.engine.posing.pin_cards import words_of
from handtrack_app.engine.posing.pin_edits import Pull
from handtrack_app.protocol.calls import command


@dataclass
class PinService:
    """Lives on the worker's thread."""

    document: Document
    edit: Callable[[int, Edit, str, str, bool], None]
    """changes a frame's pose, and shows it; at last what is done in words, the control's tag, and whether that is of one drag"""
    _pull: Pull | None = None

    @command(
        edits=True,
        latest=("frame", "camera", "tag"),
        words="pins of frame {frame}",
        at_once=drags,
    )
    def set_pin(
        self,
        frame: int,
        camera: str,
        pixel: tuple[float, float],
        version: int,
        joint: str = "",
        bone: str = "",
        point: tuple[float, float, float] = (0.0, 0.0, 0.0),
        by_images: bool = True,
        tag: str = "",
    ) -> None:
        """Let a joint, or a point of a bone [m], lie at a pixel of a camera's undistorted image. by_images: the observations hold the
        rest of the hand; else it changes least. tag: of the drag.
        """
        self._refuse_live()
        pull = self._pull
        if pull is None or (pull.tag, pull.frame) != (tag, frame):
            pull = self._pull = pin_edits.begun(self.document, frame, tag)
        pin = Pin(camera, pixel, joint, bone, point)
        placed = pin_edits.placed(self.document, pull, pin, by_images)
        self.edit(frame, placed, f"Pin of {words_of(joint or bone)} in {camera}", tag, True)

    @command(edits=True, words="pins of frame {frame}", at_once=looks_elsewhere)
    def drop_pins(
        self, frame: int, which: int | None, version: int, by_images: bool = True
    ) -> None:
        """Drop one of a frame's pins by its place in the list, or all (None)."""
        self._refuse_live()
        pull = self._pull = pin_edits.begun(self.document, frame, "")
        left = pin_edits.dropped(self.document, pull, which, by_images)
        self.edit(frame, left, "Pins dropped" if which is None else "Pin dropped", "", False)

    @command(edits=True, words="pins of frame {frame}")
    def copy_pins(self, frame: int, before: int, behind: int, version: int) -> None:
        """Copy a frame's pins to so many frames before and behind it, moved as what was tracked moves."""
        self._refuse_live()
        others = range(frame - before, frame + behind + 1)
        self.edit(frame, pin_edits.copied(self.document, frame, others), "Pins copied", "", False)

    def _refuse_live(self) -> None:
        if self.document.run.session.live is not None:
            raise HandtrackError(
                "Running cameras go on: a pin would be of an image that is gone. Record a session, and correct that."
            )
