"""The review queue: intervals of a track that are worth a look, the worst first, each with its reason and its size."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from handtrack.tracking.frame.reason import Status

if TYPE_CHECKING:
    from handtrack.tracking.frame.result import (
        FrameHead,
    )  # imports all of the model: the page does without

_JOINED = 5
"""frames without that doubt between two with it that are looked at as one interval: a fifth of a second at 25 frames a second"""
_NAMED = 3
"""intervals that a summary names"""
_UNKNOWN = 0.5
"""how probably a doubtful frame is off of which no probability is stated, as a body's: as probably as not"""


@dataclass(frozen=True)
class ReviewInterval:
    """Frames near one another that are looked at together: with one doubt, or a few with another beside them."""

    first: int
    last: int
    """inclusive"""
    worst: int
    """the frame that is most probably off"""
    expected: float
    """how many of its frames are off, by their probabilities: its size"""
    brief: str
    """the worst frame's reason in a few words"""
    words: str
    """and in a clause"""

    def __str__(self) -> str:
        frames = str(self.first) if self.first == self.last else f"{self.first}–{self.last}"
        return f"{frames}, {self.brief}"


def failure_probability(frame: FrameHead) -> float:
    """Return how probably a joint of a frame is 25 mm off: 1 of a lost hand, as probably as not where nothing is stated."""
    if frame.status == Status.LOST:
        return 1.0
    if math.isfinite(frame.p_off_25mm):
        return frame.p_off_25mm
    return _UNKNOWN if frame.status == Status.DOUBTFUL else 0.0


def intervals_to_review(
    frames: Iterable[FrameHead], done: Container[int] = ()
) -> list[ReviewInterval]:
    """Return the intervals of doubtful and lost frames, those first of which most frames are
    expected to be off.

    Doubts of different parts make intervals of their own, which may overlap; but what is seen in
    one look is one: an interval that is no longer than those frames that join, beside another
    within as many, goes with that.

    Parameters
    ----------
    frames
        Ascending.
    done
        Frames that need no look, being set by hand or accepted.
    """
    open_runs: dict[str, list[FrameHead]] = {}
    found: list[list[FrameHead]] = []
    for frame in frames:
        if frame.status not in (Status.DOUBTFUL, Status.LOST) or frame.frame in done:
            continue
        cause = _cause_of(frame)
        run = open_runs.setdefault(cause, [])
        if run and frame.frame - run[-1].frame > _JOINED + 1:
            found.append(run)
            run = open_runs[cause] = []
        run.append(frame)
    merged = _merged([*found, *open_runs.values()])
    intervals = [_interval(run) for run in merged]
    return sorted(intervals, key=lambda interval: (-interval.expected, interval.first))


def _merged(runs: list[list[FrameHead]]) -> list[list[FrameHead]]:
    """Return runs with the short ones joined to the longest that lies beside each."""
    merged: list[list[FrameHead]] = []
    near: list[list[FrameHead]] = []  # that reach as far as where the next begins
    for run in sorted(runs, key=lambda run: run[0].frame):
        near = [look for look in near if run[0].frame - look[-1].frame <= _JOINED + 1]
        joined = run
        if near and _is_short(run):
            joined = max(near, key=_length)
            joined[:] = sorted([*joined, *run], key=lambda frame: frame.frame)
        else:
            for short in [look for look in near if _is_short(look)]:
                joined = sorted([*short, *joined], key=lambda frame: frame.frame)
                merged, near = (
                    [one for one in kept if one is not short] for kept in (merged, near)
                )
            merged.append(joined)
            near.append(joined)
    return merged


def _length(run: list[FrameHead]) -> int:
    return run[-1].frame - run[0].frame + 1


def _is_short(run: list[FrameHead]) -> bool:
    return _length(run) <= _JOINED


def _cause_of(frame: FrameHead) -> str:
    """Return what frames of one interval have in common: a lost hand, a part, a camera, or the kind of doubt."""
    if frame.status == Status.LOST or frame.reason is None:
        return frame.status.name
    return frame.reason.part or (frame.reason.kind + frame.reason.camera)


def _named(frame: FrameHead) -> str:
    return "" if frame.reason is None else frame.reason.part or frame.reason.camera


def _interval(run: list[FrameHead]) -> ReviewInterval:
    worst = max(run, key=failure_probability)
    word = "lost" if worst.status == Status.LOST else "low confidence"
    brief, words = word, word
    if worst.reason is not None:
        brief, words = worst.reason.brief, worst.reason.words
    if worst.status == Status.LOST and worst.reason is not None:
        brief = f"lost: {brief}"
    others = {_named(frame): None for frame in run if _cause_of(frame) != _cause_of(worst)}
    if also := ", ".join(filter(None, others)):
        words = f"{words}; also {also}"
    expected = sum(failure_probability(frame) for frame in run)
    return ReviewInterval(run[0].frame, run[-1].frame, worst.frame, expected, brief, words)


def queue_words(intervals: list[ReviewInterval]) -> str:
    """Return the head of the queue in a sentence; empty where nothing is worth a look."""
    if not intervals:
        return ""
    named = "; ".join(map(str, intervals[:_NAMED]))
    more = f"; {len(intervals) - _NAMED} more" if len(intervals) > _NAMED else ""
    return f"worth a look, worst first: frames {named}{more}."
