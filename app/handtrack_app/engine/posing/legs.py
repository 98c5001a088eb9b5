"""Legs of a tracking: poses that are given stay as they are, or lead, and it starts again from each."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from handtrack.arrays import Floats, P
from handtrack_app.engine.posing.given import Given


@dataclass(frozen=True, eq=False)
class Leg:
    """Frames to be tracked on from one pose: forward from `first`, and backward where there are earlier ones."""

    frames: range
    first: int
    params: Floats[P]
    """to start with at `first`"""


def legs(
    frames: range, first: int, params: Floats[P], given: Given, both_ends: bool = False
) -> tuple[Leg, ...]:
    """Return in which legs frames are tracked from a pose at `first`: away from it, up to the next pose that was given, and on
    from that.

    Frames that are held are not tracked; their neighbours start from them. If the pose at `first` is among them, tracking
    begins beside it. Frames to which the solver led are tracked, from there. both_ends: of frames between two that are given, half are
    tracked from each.
    """
    held, known = given.held, {**given.led, **given.held}
    later = [k for k in sorted(known) if first < k < frames.stop]
    earlier = [k for k in sorted(known, reverse=True) if frames.start <= k < first]
    low = earlier[0] + 1 if earlier else frames.start
    high = later[0] if later else frames.stop
    found = []
    if first in held:
        found.append(Leg(range(first + 1, high), first + 1, held[first]))
        found.append(Leg(range(low, first), first - 1, held[first]))
    else:
        found.append(Leg(range(low, high), first, params))
    for mark, following in pairwise([*later, frames.stop]):
        begin = mark + 1 if mark in held else mark
        found.append(Leg(range(begin, following), begin, known[mark]))
    for mark, following in pairwise([*earlier, frames.start - 1]):
        end = mark if mark in held else mark + 1
        found.append(Leg(range(following + 1, end), end - 1, known[mark]))
    parts = (part for leg in found for part in (_halves(leg, given) if both_ends else [leg]))
    return tuple(leg for leg in parts if leg.frames)


def _halves(leg: Leg, given: Given) -> list[Leg]:
    """Return a leg between two given poses as one from each of them; any other as it is."""
    low, high = leg.frames.start, leg.frames.stop
    before = given.led.get(low, given.held.get(low - 1))
    behind = given.led.get(high, given.held.get(high))
    if before is None or behind is None:
        return [leg]
    middle = (low + high + 1) // 2
    return [Leg(range(low, middle), low, before), Leg(range(middle, high), high - 1, behind)]
