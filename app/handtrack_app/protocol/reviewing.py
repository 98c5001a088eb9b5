"""What the page asks of the engine to review a track: frames accepted, a take compared, courses shown."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CompareTake:
    """Show how far a take lies from the track; None: none."""

    number: int | None


@dataclass(frozen=True)
class WantCurves:
    """Joint parameters whose course over the recording the page shows, by name."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class Accept:
    """Accept frames as they are: neither tracking nor refining changes them; or let them go."""

    spans: tuple[tuple[int, int], ...]
    """first to last"""
    on: bool = True
