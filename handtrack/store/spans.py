"""Spans of takes, of which a track is composed. Later ones lie over earlier ones: where a take lacks a frame, the one below
shows, so a take may be laid over others before its first frame is tracked.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from handtrack.arrays import number_runs


@dataclass(frozen=True, order=True)
class Span:
    """Frames of one take."""

    take: int
    first: int
    stop: int
    """one past the last"""


def with_span(spans: Sequence[Span], put: Span) -> tuple[Span, ...]:
    """Return spans with one put over them, in the order of their frames; neighbours of one take are joined."""
    cut = [put]
    for span in spans:
        parts = ((span.first, min(span.stop, put.first)), (max(span.first, put.stop), span.stop))
        cut += [Span(span.take, first, stop) for first, stop in parts if first < stop]
    joined: list[Span] = []
    for span in sorted(cut, key=lambda s: s.first):
        if joined and joined[-1].take == span.take and joined[-1].stop == span.first:
            joined[-1] = Span(span.take, joined[-1].first, span.stop)
        else:
            joined.append(span)
    return tuple(joined)


def clipped(spans: Sequence[Span], accepted: Sequence[Sequence[int]]) -> list[Span]:
    """Return what spans show of accepted frames, half-open pairs: laid over others it stays."""
    both = ((span, first, stop) for first, stop in accepted for span in spans)
    return [Span(s.take, max(s.first, first), min(s.stop, stop)) for s, first, stop in both]


def resolved(
    spans: Sequence[Span], frames_of: Callable[[int], Collection[int]]
) -> tuple[Span, ...]:
    """Return what shows of spans that lie over one another: ascending, each frame once. frames_of: those that a take has."""
    found: tuple[Span, ...] = ()
    for span in spans:
        for first, stop in number_runs(
            f for f in frames_of(span.take) if span.first <= f < span.stop
        ):
            found = with_span(found, Span(span.take, first, stop))
    return found
