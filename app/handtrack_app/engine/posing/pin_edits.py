"""Edits by pins: what pulling at a joint or segment, letting go, or copying changes of the session's state."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from handtrack.arrays import D2, Floats, K, P, S
from handtrack.errors import HandtrackError
from handtrack.observation.observation import Observation
from handtrack.observation.pins import Pin
from handtrack.session.posed_frames import solver_params_of
from handtrack.session.session_state import NOTHING, Edit, decide, in_turn
from handtrack.terms.keypoints import pinned_places
from handtrack.tracking.pulling import pulled
from handtrack_app.engine.document import Document
from handtrack_app.engine.posing.pin_state import pinning
from handtrack_app.engine.store.edits import set_pose

_MOST = 200
"""pins of a frame; more than anybody places"""
_FAR_PX = 10_000.0


@dataclass
class Pull:
    """One drag: where it began, and what is seen meanwhile."""

    tag: str
    frame: int
    stood: Floats[P]
    seen: Observation


def placed(document: Document, pull: Pull, pin: Pin, by_images: bool) -> Edit:
    """Let a place lie at a pixel, and the hand follow. Raises HandtrackError for what is no such place."""
    model = document.model
    pinned_places(model, [pin])
    size = document.run.session.view(pin.camera).camera.size
    if not np.isfinite(pin.pixel).all() or np.abs(np.subtract(pin.pixel, size)).max() > _FAR_PX:
        raise HandtrackError(f"a pin of {pin.joint or pin.bone}: {pin.pixel} is no pixel of {pin.camera}.")  # fmt: skip
    own = document.run.session.pins.of(pull.frame)
    others = [p for p in own if p.what != pin.what]
    if len(others) >= _MOST:
        raise HandtrackError(f"Frame {pull.frame} has {_MOST} pins already; drop some first.")
    return _led(document, pull, (*others, pin), by_images)


def dropped(document: Document, pull: Pull, which: int | None, by_images: bool) -> Edit:
    """Drop one of a frame's pins, or all: then the pose goes with them where they led to it."""
    own = document.run.session.pins.of(pull.frame)
    left = () if which is None else tuple(p for n, p in enumerate(own) if n != which)
    if left == own:
        return NOTHING
    if left:
        return _led(document, pull, left, by_images)
    frame = pull.frame
    led = {frame: None} if document.decided_pose(frame).pinned else {}
    return decide(pins={frame: None}, pose=led)


def copied(document: Document, frame: int, others: Iterable[int]) -> Edit:
    """Copy a frame's pins to others, each moved as the place that it holds moves in what was tracked."""
    pins, found = document.run.session.pins, dict[int, Sequence[Pin]]()
    own = pins.of(frame)
    what = {pin.what for pin in own}
    corrections = _corrections(document, frame, own)
    for other in others:
        if other == frame or other not in document.frames:
            continue
        at = _pixels(document, _tracked(document, other), own)
        moved = [
            replace(pin, pixel=(float(x), float(y)))
            for pin, (x, y) in zip(own, at + corrections, strict=True)
            if np.isfinite([x, y]).all()
        ]
        kept = [pin for pin in pins.of(other) if pin.what not in what]
        found[other] = [*kept, *moved]
    return pinning(found)


def begun(document: Document, frame: int, tag: str) -> Pull:
    """Begin a pull at a frame, from the pose that shows there."""
    model, frame = document.model, document.clamped(frame)
    params = solver_params_of(model, document.pose_at(frame))
    seen = document.run.observation(frame, model.bones(params))
    return Pull(tag, frame, params, seen)


def _led(document: Document, pull: Pull, pins: Sequence[Pin], by_images: bool) -> Edit:
    """Return pins, and the pose to which they lead."""
    model, session = document.model, document.run.session
    names = model.joint_names, model.skeleton.bone_names
    held = session.pins.as_observed(pin for pin in pins if pin.is_on(*names))
    seen = replace(pull.seen, pins=held)
    params = solver_params_of(model, document.pose_at(pull.frame))
    tells = bool(seen.silhouettes or seen.keypoints or seen.cloud or seen.images)
    found = pulled(model, document.run.settings, seen, params, by_images and tells, pull.stood)
    posed = set_pose(document, pull.frame, model.joint_params(found), pinned=True)
    return in_turn(pinning({pull.frame: pins}), posed)


def _tracked(document: Document, frame: int) -> Floats[S]:
    """Return the pose that was tracked at a frame, else the one that shows there."""
    result = document.results.get(frame)
    return document.pose_at(frame) if result is None else result.parameters


def _corrections(document: Document, frame: int, pins: Sequence[Pin]) -> Floats[K, D2]:
    """Return how far each pin moves its place from where that was tracked [px]."""
    return np.array([p.pixel for p in pins]).reshape(-1, 2) - _pixels(
        document, _tracked(document, frame), pins
    )


def _pixels(document: Document, values: Floats[S], pins: Sequence[Pin]) -> Floats[K, D2]:
    """Return where the pinned places of a pose lie in their cameras' undistorted images [px]."""
    model, rig = document.model, document.run.session.rig
    bone, point = pinned_places(model, pins)
    places = model.bones(solver_params_of(model, values)).to_world(bone, point)
    flat = {camera.name: camera.without_distortion() for camera in rig}
    at = np.full((len(pins), 2), np.nan)
    for n, pin in enumerate(pins):
        at[n] = flat[pin.camera].project(places[n : n + 1])[0]
    return at
