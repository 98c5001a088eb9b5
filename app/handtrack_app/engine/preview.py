"""What is shown of a session while it is still being opened: cameras, images and the model, to be looked at only."""

from __future__ import annotations

from collections.abc import Callable, Sized

from handtrack_app.engine.document import Document
from handtrack_app.engine.document_snapshots import pose_snapshot, session_snapshot
from handtrack_app.engine.pictures.painter import Painter
from handtrack_app.protocol.calls import command
from handtrack_app.protocol.snapshots import Snapshot


class Preview:
    """Lives on the worker's thread. Calls besides those for frames and pictures wait until the session is open."""

    def __init__(
        self, document: Document, publish: Callable[[Snapshot], None], waiting: Sized
    ) -> None:
        self.document = document
        self.painter = Painter(document, publish, waiting)
        self._publish = publish
        publish(session_snapshot(document))

    @command()
    def show_frame(self, frame: int, is_played: bool = False) -> None:
        """Show a frame."""
        self.document.show(frame)
        self._publish(pose_snapshot(self.document))
        self.painter.is_stale = True

    @command()
    def want_pictures(
        self, thumbnails: bool, paint: str, screens: tuple[tuple[str, str], ...] = ()
    ) -> None:
        """Show these pictures; see OpenSession."""
        self.painter.want(thumbnails, paint, screens)

    @property
    def rest_s(self) -> float:
        """How long the worker may wait for a call before there is something to do."""
        return self.painter.rest_s

    def idle(self) -> None:
        """Do what waits while no call does."""
        if self.painter.is_stale:
            self.painter.paint()
