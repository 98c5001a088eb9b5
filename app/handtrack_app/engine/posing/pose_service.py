"""Poses that the page gives: set, taken from elsewhere, pulled at, let go; and looks at what was before, which change nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from handtrack.store.history import History
from handtrack_app.engine.document import Document
from handtrack_app.engine.pictures.pose_pictures import pose_picture, pose_titles
from handtrack_app.engine.posing.before import pose_before
from handtrack_app.engine.posing.pin_cards import words_of
from handtrack_app.engine.posing.pin_service import PinService
from handtrack_app.engine.store import edits
from handtrack_app.engine.store.edits import Values
from handtrack_app.protocol import posing
from handtrack_app.protocol.library import LibrarySnapshot, PosePicture
from handtrack_app.protocol.snapshots import Notice, Snapshot

Request = (
    posing.SetPose | posing.TakePose | posing.PullPlace | posing.ForgetPose | posing.LookBefore
    | posing.WantLibrary    | posing.SetPin | posing.DropPins | posing.CopyPins
)  # fmt: skip
Edit = Callable[[int, Values, str, str, bool], None]
"""changes a frame's pose, and shows it; at last what is done in words, the control's tag, and whether that is of one drag"""
_SOURCES = {"previous": "Pose of the frame before", "start": "First-frame pose"}
_NOTHING_BEFORE = "No step changed this frame's pose yet: there is no other to look at. After a fit, a drag or a moved slider there is."


@dataclass
class PoseService:
    """Lives on the worker's thread."""

    document: Document
    history: Callable[[], History]
    edit: Edit
    publish: Callable[[Snapshot], None]
    show: Callable[[], None]
    """shows the pose again"""

    def __post_init__(self) -> None:
        self._pins = PinService(self.document, self.edit)

    def serve(self, request: Request) -> None:
        """Do what is asked. Raises HandtrackError."""
        document = self.document
        match request:
            case posing.SetPose():
                if request.version >= document.version:
                    document.version = request.version
                    pose = edits.pose(document, request.frame, request.values)
                    self.edit(request.frame, pose, request.words, request.tag, request.is_stroke)
            case posing.TakePose():
                taken = edits.taken_pose(document, request.frame, request.source)
                self.edit(
                    request.frame,
                    taken,
                    _SOURCES.get(request.source, f"Pose {request.source!r}"),
                    "",
                    False,
                )
            case posing.PullPlace():
                pulled = edits.pulled_place(document, request)
                what = f"Pull of {words_of(request.joint or request.bone)}"
                self.edit(request.frame, pulled, what, request.tag, True)
            case posing.ForgetPose():
                known = document.clamped(request.frame) in document.by_hand
                forgotten = edits.forgotten_pose(request.frame) if known else {}
                self.edit(request.frame, forgotten, "Pose dropped", "", False)
            case posing.LookBefore():
                self._look(request.on)
            case posing.WantLibrary():
                drawn = (
                    PosePicture(
                        one.name, one.short, one.group, pose_picture(document.model, one.name)
                    )
                    for one in pose_titles(document.model)
                )
                self.publish(LibrarySnapshot(request.client_id, tuple(drawn)))
            case _:
                self._pins.serve(request)

    def _look(self, at_before: bool) -> None:
        document = self.document
        before = pose_before(document, self.history()) if at_before else None
        if at_before and before is None:
            self.publish(Notice("info", "Nothing before", _NOTHING_BEFORE))
        document.before = before
        self.show()
