"""Spans of takes, of which a track is composed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


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
