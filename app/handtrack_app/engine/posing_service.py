"""Poses that the page gives: set, taken from elsewhere, pulled at, let go; and looks at what was before, which change nothing."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from handtrack.arrays import Floats, P, S
from handtrack.diagnostics.score import score
from handtrack.errors import HandtrackError
from handtrack.model.pose_library import named_pose, pose_names
from handtrack.observation.observation import Observation
from handtrack.observation.pins import Pin
from handtrack.session.run import TrackingRun
from handtrack.session.session_state import (
    NOTHING,
    DecidedPose,
    Edit,
    SessionState,
    decide,
    in_turn,
    name_of,
    read,
)
from handtrack.store.history import History
from handtrack.terms.keypoints import pinned_places
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.pulling import pulled
from handtrack_app.engine.document import Document, cost_parts, pinning
from handtrack_app.engine.inverse_kinematics import reach
from handtrack_app.engine.service import Service
from handtrack_app.protocol import Command, Hold, Notice, ScoreSnapshot, Snapshot

_SOURCES = {
    "shown": "Keyframe",
    "previous": "Pose of the frame before",
    "start": "First-frame pose",
}
_NOTHING_BEFORE = "No step has changed this frame's pose yet, so there is no earlier pose to show."


_MOST = 200
"""pins of a frame; more than anybody places"""
_FAR_PX = 10_000.0


@dataclass
class Pull:
    """One drag: where it began, and what is seen meanwhile."""

    tag: str
    frame: int
    stood: Floats[P]
    observation: Observation


class PosingService(Service):
    """Poses by hand, and by pins."""

    _pull: Pull | None = None

    @Command(edits=True, latest=("frame", "tag"), at_once="give_way")
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
            self.opened.edit(frame, pose(self.document, frame, values), words, tag, is_stroke)

    @Command(edits=True, at_once="stop_following")
    def take_pose(self, frame: int, source: str, version: int) -> None:
        """Set a frame's pose by hand to the one that shows there (`shown`: a keyframe), to `start` (the first-frame pose), `previous`
        (the frame before), or a pose of the library, for the fingers.
        """
        document = self.document
        current, model = document.pose_at(frame), document.model
        taken = document.start
        if source in pose_names(model.kind):
            taken = named_pose(model, source)
            taken[:6] = current[:6]
        elif source == "previous":
            earlier = range(frame - 1, document.frames.start - 1, -1)
            known = (f for f in earlier if f in document.by_hand or f in document.results)
            if (before := next(known, None)) is not None:
                taken = document.pose_at(before)
        elif source == "shown":
            taken = current
        edit = pose(document, frame, taken.tolist())
        self.opened.edit(frame, edit, _SOURCES.get(source, f"Pose {source!r}"))

    @Command(
        edits=True,
        latest=("frame", "hold", "tag"),
        at_once="give_way",
    )
    def pull_place(
        self,
        frame: int,
        target: tuple[float, float, float],
        version: int,
        hold: Hold,
        tag: str = "",
    ) -> None:
        """Bend a finger or limb so that what is held comes to a target in world [m]. tag: of the drag."""
        document, meant = self.document, np.asarray(target, dtype=float)
        model = document.model
        (bone,), (point,) = pinned_places(model, [Pin("", (0.0, 0.0), *hold)])
        params = model.params_within_limits(document.pose_at(frame))
        reached = model.joint_params(reach(model, params, int(bone), point, meant))
        edit = pose(document, frame, reached.tolist())
        self.opened.edit(frame, edit, f"Pull of {hold.words}", tag, True)

    @Command(edits=True, at_once="stop_following")
    def forget_pose(self, frame: int, version: int) -> None:
        """Drop what was set by hand at a frame; the tracked pose shows again."""
        forgotten = decide(pose={frame: None}) if frame in self.document.by_hand else NOTHING
        self.opened.edit(frame, forgotten, "Pose dropped")

    @Command(at_once="stop_following")
    def look_before(self, on: bool) -> None:
        """Show the frame's pose as it was before the last step that changed it, or as it is; a look, no edit."""
        document = self.document
        before = pose_before(document, self.store.history) if on else None
        if on and before is None:
            self.publish(Notice("info", "Nothing before", _NOTHING_BEFORE))
        document.before = before
        self.opened.show_pose()

    @Command(
        edits=True,
        latest=("frame", "camera", "tag"),
        at_once="give_way",
    )
    def set_pin(
        self,
        frame: int,
        camera: str,
        pixel: tuple[float, float],
        version: int,
        hold: Hold,
        by_images: bool = True,
        tag: str = "",
    ) -> None:
        """Let what is held lie at a pixel of a camera's undistorted image. by_images: the observations hold the rest of the hand; else
        it changes least. tag: of the drag.
        """
        self._refuse_live()
        if self._pull is None or (self._pull.tag, self._pull.frame) != (tag, frame):
            self._pull = self._begun(frame, tag)
        pin, session = Pin(camera, pixel, *hold), self.document.session
        pinned_places(self.document.model, [pin])
        size = session.view(camera).camera.size
        if not np.isfinite(pixel).all() or np.abs(np.subtract(pixel, size)).max() > _FAR_PX:
            raise HandtrackError(f"a pin of {hold.words}: {pixel} is no pixel of {camera}.")
        others = [p for p in session.pins.of(frame) if p.what != pin.what]
        if len(others) >= _MOST:
            raise HandtrackError(f"Frame {frame} has {_MOST} pins already; drop some first.")
        edit = self._led(self._pull, (*others, pin), by_images)
        self.opened.edit(frame, edit, f"Pin of {hold.words} in {camera}", tag, True)

    @Command(edits=True, at_once="stop_following")
    def drop_pins(
        self, frame: int, which: int | None, version: int, by_images: bool = True
    ) -> None:
        """Drop one of a frame's pins by its place in the list, or all (None)."""
        self._refuse_live()
        document = self.document
        self._pull = self._begun(frame, "")
        own, edit = document.session.pins.of(frame), NOTHING
        left = () if which is None else tuple(p for n, p in enumerate(own) if n != which)
        if left and left != own:
            edit = self._led(self._pull, left, by_images)
        elif not left and own:  # the pose goes with them where they led to it
            led = {frame: None} if document.decided_pose(frame).pinned else {}
            edit = decide(pins={frame: None}, pose=led)
        self.opened.edit(frame, edit, "Pins dropped" if which is None else "Pin dropped")

    def _begun(self, frame: int, tag: str) -> Pull:
        """Begin a pull at a frame, from the pose that shows there."""
        model = self.document.model
        params = model.params_within_limits(self.document.pose_at(frame))
        return Pull(tag, frame, params, self.document.run.observation(frame, model.bones(params)))

    def _led(self, pull: Pull, pins: Sequence[Pin], by_images: bool) -> Edit:
        """Return pins, and the pose to which they lead."""
        document = self.document
        model = document.model
        names = model.joint_names, model.skeleton.bone_names
        held = document.session.pins.as_observed(pin for pin in pins if pin.is_on(*names))
        observed = replace(pull.observation, pins=held)
        params = model.params_within_limits(document.pose_at(pull.frame))
        is_observed = bool(
            observed.silhouettes or observed.keypoints or observed.cloud or observed.images
        )
        result = pulled(
            model, document.run.settings, observed, params, by_images and is_observed, pull.stood
        )
        posed = set_pose(document, pull.frame, model.joint_params(result), pinned=True)
        return in_turn(pinning({pull.frame: pins}), posed)

    def _refuse_live(self) -> None:
        if self.document.session.live is not None:
            raise HandtrackError(
                "Live images cannot be pinned. Record a session, and correct that."
            )


def pose(document: Document, frame: int, values: Sequence[float]) -> Edit:
    """Set a frame's pose, moved into the limits in force."""
    model, given = document.model, np.asarray(values, dtype=float)
    if given.shape != (len(model.parameter_names),):
        return NOTHING  # sent before the model changed
    return set_pose(document, frame, model.joint_params(model.params_within_limits(given)))


def set_pose(document: Document, frame: int, values: Floats[S], **how: bool) -> Edit:
    """Set a frame's pose as it is, within limits. how: `found` by a search, `pinned`, or `refitted`."""
    known = document.decided_pose(frame).parameters  # of other models, too
    now = document.model.named(values)
    return decide(pose={frame: DecidedPose({**known, **now}, **how)})


_SAME = 1e-9
"""[m, rad] a pose that was written and read again differs by less"""


def pose_before(document: Document, history: History) -> Floats[S] | None:
    """Return the joint parameters of the frame shown before the last step of the history that changed them; None where no step
    did, or nobody knew a pose before.
    """
    state, here = document.state, ("pose", document.frame)
    names, now = {name_of(here), name_of(("spans", None))}, document.shown
    for step in history.latest_first:
        earlier = read({c.key: c.before for c in step.changes if c.key in names})
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
    result = document.composed(state.spans)[0].get(frame)
    if result is not None:
        return result.parameters
    return document.start if frame == document.first_frame else None


# ---- The score of the pose shown


_RESTS_S = 0.2  # a frame's masks are made for the score once it is looked at for so long
_FIRST_S = (
    2.0  # and what it is computed by is loaded, which takes seconds, once nobody is in a hurry
)


@dataclass
class LiveScore:
    """Lives on the worker's thread."""

    document: Document
    publish: Callable[[Snapshot], None]
    since: float | None = None
    """when a pose was shown that has no score yet"""
    _frame: int | None = None
    """scored last: what was seen of it is at hand"""
    _fitted: tuple[FrameResult, TrackingRun, dict[str, float], float] | None = None
    """its overlaps and whole energy by the settings in force, as what is compared with it"""

    @property
    def is_due(self) -> bool:
        """Whether there is a pose to score, and it may be done now."""
        if self.since is None or self.document.session.live is not None:
            return False
        at_hand = self._frame == self.document.frame
        rests_s = _FIRST_S if self._frame is None else _RESTS_S
        return at_hand or time.monotonic() - self.since > rests_s

    def report(self) -> None:
        """Score the pose shown, and the one that was fitted to its frame last."""
        document, self.since = self.document, None
        self._frame = frame = document.frame
        params = document.model.params_within_limits(document.displayed)
        (overlap, energy), result = self._score(frame, params), document.results.get(frame)
        if result is None or len(result.parameters) != len(document.shown):
            self._fitted = None
        elif self._fitted is None or self._fitted[:2] != (result, document.run):
            params = document.model.params_within_limits(result.parameters)
            fitted, costs = self._score(frame, params)
            self._fitted = result, document.run, fitted, sum(costs.values())
        self.publish(
            ScoreSnapshot(
                frame, tuple(document.displayed.tolist()), overlap, dict(cost_parts(energy)),
                *((None, None) if self._fitted is None else self._fitted[2:]),
            )
        )  # fmt: skip

    def _score(self, frame: int, params: Floats[P]) -> tuple[dict[str, float], dict[str, float]]:
        model, run = self.document.model, self.document.run
        observed = run.observation(frame, model.bones(params))
        return score(model, run.settings, observed, params)
