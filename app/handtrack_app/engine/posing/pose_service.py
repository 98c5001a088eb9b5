"""Poses that the page gives: set, taken from elsewhere, pulled at, let go; and looks at what was before, which change nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats, S
from handtrack.observation.pins import Pin
from handtrack.session.session_state import NOTHING, Edit, SessionState, name_of, read
from handtrack.store.history import History, merged
from handtrack_app.engine.document import Document
from handtrack_app.engine.job_control import drags, looks_elsewhere
from handtrack_app.engine.pictures.pose_pictures import pose_picture, pose_titles
from handtrack_app.engine.posing.pin_cards import words_of
from handtrack_app.engine.store import edits
from handtrack_app.protocol.calls import command
from handtrack_app.protocol.library import LibrarySnapshot, PosePicture
from handtrack_app.protocol.snapshots import Notice, Snapshot

MakeEdit = Callable[[int, Edit, str, str, bool], None]
"""changes a frame's pose, and shows it; at last what is done in words, the control's tag, and whether that is of one drag"""
_SOURCES = {"previous": "Pose of the frame before", "start": "First-frame pose"}
_NOTHING_BEFORE = "No step changed this frame's pose yet: there is no other to look at. After a fit, a drag or a moved slider there is."


@dataclass
class PoseService:
    """Lives on the worker's thread."""

    document: Document
    history: Callable[[], History]
    edit: MakeEdit
    publish: Callable[[Snapshot], None]
    show: Callable[[], None]
    """shows the pose again"""

    @command(edits=True, latest=("frame",), words="the pose of frame {frame}", at_once=drags)
    def set_pose(
        self,
        frame: int,
        values: tuple[float, ...],
        version: int,
        tag: str = "",
        is_stroke: bool = False,
        words: str = "Pose",
    ) -> None:
        """Set the whole pose of a frame by hand.

        values: (S,) joint parameters [m, rad]. version: counts the user's edits; the answering snapshot carries it back. tag: the
        control that is moved: what follows soon with the same is one step of undo. is_stroke: the tag is of this one drag: one step,
        however long it takes. words: what is done, for undo.
        """
        if version >= self.document.version:
            self.edit(frame, edits.pose(self.document, frame, values), words, tag, is_stroke)

    @command(edits=True, words="the pose of frame {frame}", at_once=looks_elsewhere)
    def take_pose(self, frame: int, source: str, version: int) -> None:
        """Replace a frame's pose by `start` (the first-frame pose), `previous` (the frame before), or a pose of the library, for the
        fingers.
        """
        taken = edits.taken_pose(self.document, frame, source)
        self.edit(frame, taken, _SOURCES.get(source, f"Pose {source!r}"), "", False)

    @command(
        edits=True,
        latest=("frame", "joint", "bone", "tag"),
        words="the pose of frame {frame}",
        at_once=drags,
    )
    def pull_place(
        self,
        frame: int,
        target: tuple[float, float, float],
        version: int,
        joint: str = "",
        bone: str = "",
        point: tuple[float, float, float] = (0.0, 0.0, 0.0),
        tag: str = "",
    ) -> None:
        """Bend a finger or limb so that a joint, or a point of a bone [m], comes to a target in world [m]. tag: of the drag."""
        pulled = edits.pulled_place(
            self.document, frame, target, Pin("", (0.0, 0.0), joint, bone, point)
        )
        self.edit(frame, pulled, f"Pull of {words_of(joint or bone)}", tag, True)

    @command(edits=True, words="dropping the pose of frame {frame}", at_once=looks_elsewhere)
    def forget_pose(self, frame: int, version: int) -> None:
        """Drop what was set by hand at a frame; the tracked pose shows again."""
        known = self.document.clamped(frame) in self.document.by_hand
        forgotten = edits.forgotten_pose(frame) if known else NOTHING
        self.edit(frame, forgotten, "Pose dropped", "", False)

    @command(job=True, words="the pose library")
    def want_library(self, client_id: int) -> None:
        """Send one client the pose library in pictures."""
        model = self.document.model
        drawn = (
            PosePicture(one.name, one.short, one.group, pose_picture(model, one.name))
            for one in pose_titles(model)
        )
        self.publish(LibrarySnapshot(client_id, tuple(drawn)))

    @command(at_once=looks_elsewhere)
    def look_before(self, on: bool) -> None:
        """Show the frame's pose as it was before the last step that changed it, or as it is; a look, no edit."""
        document = self.document
        before = pose_before(document, self.history()) if on else None
        if on and before is None:
            self.publish(Notice("info", "Nothing before", _NOTHING_BEFORE))
        document.before = before
        self.show()


_SAME = 1e-9
"""[m, rad] a pose that was written and read again differs by less"""


def pose_before(document: Document, history: History) -> Floats[S] | None:
    """Return the joint parameters of the frame shown before the last step of the history that changed them; None where no step
    did, or nobody knew a pose before.
    """
    state, here = document.state, ("pose", document.frame)
    names, now = {name_of(here), name_of(("spans", None))}, document.shown
    for step in history.past.latest_first():
        earlier = read({c.key: c.before for c in merged(step) if c.key in names})
        if not earlier:
            continue
        state = state.having(earlier)
        was = _pose(document, state)
        if was is not None and np.abs(was - now).max() > _SAME:
            return was
    return None


def _pose(document: Document, state: SessionState) -> Floats[S] | None:
    """Return the pose that showed at the frame when this was decided."""
    frame, decided = document.frame, state.pose.get(document.frame)
    if decided is not None:
        return document.posed(decided)
    for span in reversed(state.spans):
        take = document.takes.get(span.take) if span.first <= frame < span.stop else None
        if take is not None and take.parameter_names == document.model.parameter_names:
            result = take.get(frame)  # where it lacks the frame, the one below shows
            if result is not None:
                return result.parameters
    return document.start if frame == document.first_frame else None
