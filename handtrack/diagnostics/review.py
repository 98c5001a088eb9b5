"""The review queue: stretches of a track that are worth a look, the worst first, each with its reason and its size."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable
from dataclasses import dataclass
from typing import Protocol

from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import Status

_JOINED = 5
"""frames without that doubt between two with it that are looked at as one stretch: a fifth of a second at 25 frames a second"""
_UNKNOWN = 0.5
"""how probably a doubtful frame is off of which no probability is stated, as a body's: as probably as not"""


class Judged(Protocol):
    """A tracked frame as far as it is judged: a FrameResult, or what is known of it without its arrays."""

    @property
    def frame(self) -> int: ...
    @property
    def status(self) -> Status: ...
    @property
    def reason(self) -> Reason | None: ...
    @property
    def p_off_25mm(self) -> float: ...


@dataclass(frozen=True)
class Stretch:
    """Frames near one another with one doubt."""

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


def probability_off(frame: Judged) -> float:
    """Return how probably a joint of a frame is 25 mm off: 1 of a lost hand, as probably as not where nothing is stated."""
    if frame.status == Status.LOST:
        return 1.0
    if math.isfinite(frame.p_off_25mm):
        return frame.p_off_25mm
    return _UNKNOWN if frame.status == Status.DOUBTFUL else 0.0


def worth_a_look(frames: Iterable[Judged], done: Container[int] = ()) -> list[Stretch]:
    """Return the stretches of doubtful and lost frames, those first of which most frames are expected to be off.

    frames: ascending; done: frames that need no look, being set by hand or accepted. Doubts of different parts make stretches
    of their own, which may overlap.
    """
    open_runs: dict[str, list[Judged]] = {}
    found: list[Stretch] = []
    for frame in frames:
        if frame.status not in (Status.DOUBTFUL, Status.LOST) or frame.frame in done:
            continue
        doubt = _doubt_of(frame)
        run = open_runs.setdefault(doubt, [])
        if run and frame.frame - run[-1].frame > _JOINED + 1:
            found.append(_stretch(run))
            run = open_runs[doubt] = []
        run.append(frame)
    found += [_stretch(run) for run in open_runs.values()]
    return sorted(found, key=lambda stretch: (-stretch.expected, stretch.first))


def _doubt_of(frame: Judged) -> str:
    """Return what frames of one stretch have in common: a lost hand, a part, a camera, or the kind of doubt."""
    if frame.status == Status.LOST or frame.reason is None:
        return frame.status.name
    return frame.reason.part or (frame.reason.kind + frame.reason.camera)


def _stretch(run: list[Judged]) -> Stretch:
    worst = max(run, key=probability_off)
    word = worst.status.name.lower()
    brief, words = word, word
    if worst.reason is not None:
        brief, words = worst.reason.brief, worst.reason.words
    if worst.status == Status.LOST and worst.reason is not None:
        brief = f"lost: {brief}"
    expected = sum(probability_off(frame) for frame in run)
    return Stretch(run[0].frame, run[-1].frame, worst.frame, expected, brief, words)


def queue_words(stretches: list[Stretch], most: int = 3) -> str:
    """Return the head of the queue in a sentence; empty where nothing is worth a look."""
    if not stretches:
        return ""
    named = "; ".join(map(str, stretches[:most]))
    more = f"; {len(stretches) - most} more" if len(stretches) > most else ""
    return f"worth a look, worst first: frames {named}{more}."
