"""How a job went, in words."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from handtrack.model.articulated import HandScale
from handtrack.session.first_pose.first_pose_candidate import FirstPoseCandidate
from handtrack.session.run import TrackingRun
from handtrack.tracking.frame.assessment import OutlineFit, hand_words
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack_app.engine.document import Document
from handtrack_app.engine.jobs import BackgroundJob, JobEnded
from handtrack_app.engine.live.live_control import LiveControl
from handtrack_app.protocol.snapshots import Notice

_TOLD_MM = 5.0  # a joint's move that one sees: half a finger's breadth


_NOT_FOUND = {
    "hand": "No searched frame has a hand that silhouettes or clouds identify with confidence. Try a frame in which the "
    "hand is open and entirely in view, or pose it yourself.",
    "body": "No searched frame has a body that its joints identify with confidence. Try a frame in which it is entirely in view, or "
    "pose it yourself.",
}


def found_words(candidates: Sequence[FirstPoseCandidate], kind: str) -> Notice:
    """Return what a search for a hand or a body found."""
    if not candidates:
        return Notice("warning", f"No {kind} found", _NOT_FOUND[kind])
    best, more = candidates[0], len(candidates) - 1
    text = f"Frame {best.frame}, {100 * best.confidence:.0f} % sure: {best.note}."
    if more:
        text += f" {more} other {'pose is' if more == 1 else 'poses are'} below and in the scene; a click takes one."
    return Notice("done", f"The {kind} is found", text)


def one_frame(result: FrameResult, fit: OutlineFit | None) -> Notice:
    """Return how fitting one frame went. fit: to its silhouettes, where there are some."""
    if result.status == Status.TRACKED:
        words = "The pose explains what was observed." if fit is None else fit.words
        return Notice("done", f"Frame {result.frame} is fitted", words)
    if result.is_open or result.is_unlikely or result.is_unconfirmed:
        return Notice(
            "warning",
            f"Frame {result.frame} fits, with low confidence",
            f"{result.note[:1].upper()}{result.note[1:]}.",
        )
    text = result.note or "The pose does not explain the observations"
    return Notice(
        "warning", f"Frame {result.frame} does not fit well", f"{text}. Undo brings your pose back."
    )


class Outcome(NamedTuple):
    """What is told of a frame in the end; without its arrays, for there may be many."""

    status: Status
    poor_cloud: bool
    is_simplified: bool

    @classmethod
    def of(cls, result: FrameResult) -> Outcome:
        return cls(result.status, result.poor_cloud, result.is_simplified)


def summary(results: Sequence[Outcome], total: int, by_hand: int, seconds: float) -> str:
    """Return how a run of tracking went, in one sentence or two.

    total: frames that were to be tracked. by_hand: frames that stayed as they were given.
    """
    counts = np.bincount([int(result.status) for result in results], minlength=5)
    done = len(results)
    speed = f"{1000 * seconds / max(done, 1):.0f} ms a frame"
    odd = [
        f"{counts[i]} {word}" for i, word in ((1, "with low confidence"), (2, "lost")) if counts[i]
    ]
    poor = sum(result.poor_cloud for result in results)
    if poor:
        odd.append(f"{poor} with a poor cloud")
    held = sum(result.is_simplified for result in results)
    if held:
        odd.append(f"{held} with the fingers fixed, because the cloud is too poor")
    quality = ", ".join(odd) if odd else "none with low confidence"
    hand = f" {by_hand} set by hand or detected are unchanged." if by_hand > 1 else ""
    if by_hand == 1:
        hand = " One, set by hand or detected, is unchanged."
    return f"{done} of {total} frames in {seconds:.1f} s ({speed}); {quality}.{hand}"


def size_words(run: TrackingRun) -> str:
    """Return how fitting the size before tracking went."""
    known = hand_words(run.model).removeprefix("hand ")
    return f"The {run.model.kind} is {run.scale.overall:.2f} times an adult's mean{known and f': {known}'}."


def offer_words(run: TrackingRun, offered: HandScale | None) -> str:
    """Return how fitting the size after tracking went. offered: what was found, where it is another."""
    size = run.scale.overall
    if offered is None:
        return f"No tracked frame measures it better: it stays {size:.2f} times the adult mean."
    return (
        f"The {run.model.kind} is {offered.overall:.2f} times an adult's mean; it was tracked with {size:.2f}. In the tab "
        "Track, 'Track again' takes the new size."
    )


@dataclass
class Moved:
    """How far refining moved frames."""

    frames: int = 0
    """that it returned"""
    most_mm: dict[int, float] = field(default_factory=dict)
    """of those that it moved by more than is told, their furthest joint"""

    def note(self, before: FrameResult | None, after: FrameResult) -> None:
        """Take a frame as it was and as it is."""
        self.frames += 1
        if before is not None:
            moves = np.linalg.norm(after.joint_positions - before.joint_positions, axis=1)
            if (most := 1e3 * float(moves.max())) > _TOLD_MM:
                self.most_mm[after.frame] = most

    @property
    def words(self) -> str:
        """What changed, in a sentence; empty where nothing was refined."""
        if not self.frames:
            return ""
        if not self.most_mm:
            return f"Refined together; no joint moved by more than {_TOLD_MM:g} mm."
        worst = max(self.most_mm, key=lambda frame: self.most_mm[frame])
        count = len(self.most_mm)
        many = f"1 frame has a joint that moved by more than {_TOLD_MM:g} mm, frame"
        if count > 1:
            many = (
                f"{count} frames have a joint that moved by more than {_TOLD_MM:g} mm, most frame"
            )
        return f"Refined together; {many} {worst} ({self.most_mm[worst]:.0f} mm)."


def end_words(
    job: BackgroundJob,
    end: JobEnded,
    document: Document,
    outcomes: Sequence[Outcome],
    moved: Moved,
    live: LiveControl | None,
) -> Notice | None:
    """Return how a job went; None where there is nothing to say."""
    cancelled = end.cancelled
    if end.internal:
        return Notice.of_mistake(end.error, "Internal error while tracking")
    if end.error:
        title = "Not carried on" if job.kind == "carrying" else "Tracking stopped"
        return Notice("error", title, end.error)
    if job.kind in ("finding", "carrying", "sizing") or (
        cancelled and not outcomes and live is None
    ):
        return Notice("done", "Cancelled", "") if cancelled else None
    if job.kind == "refining":
        return (
            Notice("done", "Cancelled", "") if cancelled else Notice("done", "Refined", moved.words)
        )
    if live is not None and job.total == 0:
        return Notice("done", "Tracking ended", live.words())
    one = document.results.get(job.frames.start) if len(job.frames) == 1 else None
    if one is not None and not cancelled:
        params = document.model.transform.solver_params(one.parameters)
        return one_frame(one, document.run.fit_of(one.frame, params)[1])
    took = time.monotonic() - job.began - job.waited
    text = summary(outcomes, job.total, len(job.frames) - job.total, took)
    title = "Cancelled" if cancelled else "Tracking finished"
    return Notice("done", title, f"{text} {moved.words}".rstrip())
