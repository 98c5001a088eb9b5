"""How a job went, in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from handtrack.tracking.frame.result import FrameResult, Status
from handtrack_app.protocol.snapshots import Notice


def one_frame(result: FrameResult) -> Notice:
    """Return how fitting one frame went."""
    if result.status == Status.TRACKED:
        return Notice("done", f"Frame {result.frame} is fitted", "What was seen is explained well.")
    if result.is_open:
        return Notice(
            "warning",
            f"Frame {result.frame} fits, as far as it is seen",
            f"In doubt: {result.note}.",
        )
    text = result.note or "What was seen is not explained well."
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
    odd = [f"{counts[i]} {word}" for i, word in ((1, "doubtful"), (2, "lost")) if counts[i]]
    poor = sum(result.poor_cloud for result in results)
    if poor:
        odd.append(f"{poor} in a poor cloud")
    held = sum(result.is_simplified for result in results)
    if held:
        odd.append(f"{held} with the fingers held, where the cloud is too poor for them")
    quality = ", ".join(odd) if odd else "none doubtful"
    hand = f" {by_hand} set by hand or found stayed as they are." if by_hand > 1 else ""
    if by_hand == 1:
        hand = " One, set by hand or found, stayed as it is."
    return f"{done} of {total} frames in {seconds:.1f} s ({speed}); {quality}.{hand}"
