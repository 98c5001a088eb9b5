"""What the workbench asks of `track_session`, and what frames were refined with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats, S
from handtrack.observation.pins import Pin
from handtrack.session.posed_frames import keyframe_result
from handtrack.session.run import TrackingRun
from handtrack.session.track_session import TrackingRequest
from handtrack.store.spans import Span
from handtrack_app.engine.document import Document


def tracking_request(
    document: Document, frames: range, first: int, anew: bool = False, both_ends: bool = False
) -> TrackingRequest:
    """Return the request to track frames from the pose at `first`, by all that was decided; a single frame by nothing else.

    anew: tracking starts at `first` by itself, so a keyframe there is only a start; see Document.start_pose.
    """
    run, start = document.run, document.start_pose(first, anew)
    if len(frames) == 1:
        return TrackingRequest(frames, first, start, fit_size=False, track_again=False)
    posed, guides = document.keyframes(frames), document.guides(frames)
    accepted = {f for f in document.accepted if f in frames and document.is_locked(f)}
    posed |= {f: document.by_hand[f] for f in accepted if f in document.by_hand}
    fixed = {f: keyframe_result(run, f, pose) for f, pose in posed.items()}
    fixed |= {f: document.results[f] for f in accepted - posed.keys()}
    started = set() if first in document.accepted or not anew else {first}
    return TrackingRequest(
        frames,
        first,
        start,
        {f: result for f, result in fixed.items() if f not in started},
        {f: pose for f, pose in guides.items() if f not in accepted | started},
        both_ends,
        fit_size=document.size_pending,
        track_again=False,  # another size is offered, and taken where the user wants it
    )


@dataclass(frozen=True, eq=False)
class RefinedWith:
    """What frames were refined with."""

    run: TrackingRun
    spans: tuple[Span, ...]
    """of the current track, once they lay in it"""
    keyframes: Mapping[int, Floats[S]]
    pins: Mapping[int, tuple[Pin, ...]]

    @classmethod
    def of(cls, document: Document) -> RefinedWith:
        """Return what frames would be refined with now."""
        pins = document.run.session.pins
        return cls(
            document.run,
            document.state.spans,
            document.keyframes(document.frames),
            {frame: pins.of(frame) for frame in pins.frames},
        )

    def changed(self, now: RefinedWith) -> list[int] | None:
        """Return at which frames keyframes or pins are new or moved; None where none is, where one was let go, or anything else may
        have changed.
        """
        before, after = self.keyframes, now.keyframes
        gone = (before.keys() - after.keys()) | (self.pins.keys() - now.pins.keys())
        if gone or now.run is not self.run or now.spans != self.spans:
            return None
        same = {f for f in before.keys() & after.keys() if np.array_equal(before[f], after[f])}
        posed = after.keys() - same
        pinned = {f for f, pins in now.pins.items() if self.pins.get(f, ()) != pins}
        return sorted(posed | pinned) or None
