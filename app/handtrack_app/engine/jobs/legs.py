"""Keyframes: poses set by hand stay as they are, and tracking starts again from each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

from handtrack.arrays import Floats


@dataclass(frozen=True, eq=False)
class Leg:
    """Frames to be tracked on from one pose: forward from `first`, and backward where there are earlier ones."""

    frames: range
    first: int
    params: Floats
    """(P,) to start with at `first`"""


def legs(frames: range, first: int, params: Floats, held: Mapping[int, Floats]) -> tuple[Leg, ...]:
    """Return in which legs frames are tracked from a pose (P,) at `first`: away from it, up to the next keyframe, and on
    from that.

    held: poses (P,) set by hand, by frame. They are not tracked; their neighbours start from them. If the pose at
    `first` is among them, tracking begins beside it.
    """
    later = [k for k in sorted(held) if first < k < frames.stop]
    earlier = [k for k in sorted(held, reverse=True) if frames.start <= k < first]
    low = earlier[0] + 1 if earlier else frames.start
    high = later[0] if later else frames.stop
    found = []
    if first in held:
        found.append(Leg(range(first + 1, high), first + 1, held[first]))
        found.append(Leg(range(low, first), first - 1, held[first]))
    else:
        found.append(Leg(range(low, high), first, params))
    for mark, following in pairwise([*later, frames.stop]):
        found.append(Leg(range(mark + 1, following), mark + 1, held[mark]))
    for mark, following in pairwise([*earlier, frames.start - 1]):
        found.append(Leg(range(following + 1, mark), mark - 1, held[mark]))
    return tuple(leg for leg in found if leg.frames)
