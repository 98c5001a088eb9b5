"""Frames that no tracking changes: keyframes, and those that the user has accepted."""

from __future__ import annotations

from handtrack.errors import HandtrackError
from handtrack_app.engine.document import Document
from handtrack_app.engine.posing.given import Given
from handtrack_app.engine.posing.page_values import params_of


def given_poses(document: Document, frames: range) -> Given:
    """Return the poses that are given at some frames; accepted ones are held."""
    accepted = sorted(f for f in document.accepted if f in frames and is_locked(document, f))
    held = {f: params_of(document.model, document.pose_at(f)) for f in accepted}
    led = {f: pose for f, pose in document.led(frames).items() if f not in held}
    return Given({**document.keyframes(frames), **held}, led)


def is_locked(document: Document, frame: int) -> bool:
    """Return whether a frame was accepted, and its pose shows: not under another model."""
    return frame in document.accepted and (frame in document.by_hand or frame in document.results)


def refuse_to_fit(document: Document, frame: int) -> None:
    """Raise HandtrackError for a frame that was accepted."""
    if frame in document.accepted:
        raise HandtrackError(
            f"Frame {frame} is accepted, so no fit changes it. Let it go first: in the tab Review."
        )
