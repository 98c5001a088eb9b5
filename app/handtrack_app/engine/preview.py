"""What is shown of a session while it is still being opened: cameras, images and the model, to be looked at only."""

from __future__ import annotations

from collections.abc import Callable, Sized

from handtrack_app.engine.document import Document
from handtrack_app.engine.document_snapshots import pose_snapshot, session_snapshot
from handtrack_app.engine.open_session import Request
from handtrack_app.engine.pictures.painter import Painter
from handtrack_app.protocol import commands
from handtrack_app.protocol.snapshots import Snapshot


class Preview:
    """Lives on the worker's thread. What is asked for besides frames and pictures waits until the session is open."""

    def __init__(
        self, document: Document, publish: Callable[[Snapshot], None], waiting: Sized
    ) -> None:
        self.document = document
        self.later: list[Request | commands.Numbered] = []
        """commands that the open session is to serve, in their order"""
        self.painter = Painter(document, publish, waiting)
        self._publish = publish

    def show_first(self) -> None:
        """Show cameras, the model and the images of its frame."""
        self._publish(session_snapshot(self.document))
        self._show(self.document.first_frame)

    def serve(self, request: Request | commands.Numbered) -> None:
        """Show another frame or other pictures, or keep a command for later."""
        command = request.command if isinstance(request, commands.Numbered) else request
        match command:
            case commands.ShowFrame():
                self._show(command.frame)
                self.later.append(request)
            case commands.WantPictures():
                self.painter.want(command)
            case _:
                self.later.append(request)

    @property
    def rest_s(self) -> float:
        """How long the worker may wait for a command before there is something to do."""
        return self.painter.rest_s

    def idle(self) -> None:
        """Do what waits while no command does."""
        if self.painter.is_stale:
            self.painter.paint()

    def _show(self, frame: int) -> None:
        self.document.show(frame)
        self._publish(pose_snapshot(self.document))
        self.painter.is_stale = True
