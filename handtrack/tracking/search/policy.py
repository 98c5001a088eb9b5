"""When a frame is searched: what makes a lost finger or a lost hand suspected."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

import numpy as np

from handtrack.tracking.frame.confidence import FEWEST_FRAMES, energy_ratio
from handtrack.tracking.frame.constants import SEARCH_EVERY
from handtrack.tracking.frame.result import FrameResult, Status

SUSPICIOUS_RATIO = 1.4
"""times the usual energy from which a finger may be lost"""
SUSPICIOUS_FRAMES = FEWEST_FRAMES
"""the first frames, in which nothing vouches for any pose"""
UNSEEN_EVERY = 5
"""frames between two searches in a row where nothing was seen near the expected position"""


def why_fingers_may_be_lost(
    frame: int, energy: float, views: int, previous: Sequence[FrameResult]
) -> str:
    """Return why lost fingers are looked for in a frame; empty where they are not.

    When it fits worse than usual, of several such frames in a row the first, second, fourth, eighth …, as for a lost hand; in one of the
    first frames, which nothing vouches for; and every so many frames: a finger hidden in a fist may settle wrongly with the usual energy.
    """
    if frame % SEARCH_EVERY == SEARCH_EVERY - 1:
        return f"every {SEARCH_EVERY}th frame"
    if len(previous) < SUSPICIOUS_FRAMES:
        return f"one of the first {SUSPICIOUS_FRAMES} frames"
    ratio = energy_ratio(energy, views, previous)
    if ratio <= SUSPICIOUS_RATIO:
        return ""
    suspicious = energy / max(views, 1) * SUSPICIOUS_RATIO / ratio
    before = takewhile(lambda r: r.energy / max(r.views, 1) > suspicious, reversed(previous))
    row = 1 + len(list(before))
    return f"{ratio:.2f} times the usual cost, frame {row} of a row" if _is_due(row) else ""


def why_hand_may_be_lost(result: FrameResult, previous: Sequence[FrameResult]) -> str:
    """Return why the hand is looked for elsewhere; empty where it is not.

    When a frame does not fit; of several such frames in a row the first, second, fourth, eighth …: what was not found in
    one of them is rarely found in the next. A frame in which nothing was seen ends such a row and begins one of its own
    (there may be a cloud, but far from where the hand was expected), of which every fifth is looked at as well. Among the wrong points
    of a poor cloud, and among those of other things, another hand often fits better: there nothing is looked for while the hand is not lost.
    """
    if result.fits or not previous or result.clutters:
        return ""
    unseen, row = not np.isfinite(result.energy), 1
    for before in reversed(previous):
        if before.fits or not (unseen or np.isfinite(before.energy)):
            break
        row += 1
    due = _is_due(row) or (unseen and row % UNSEEN_EVERY == 0)
    return f"frame {row} of a series without a good fit: {result.note}" if due else ""


def searches_everywhere(previous: Sequence[FrameResult]) -> bool:
    """Return whether the next frame is one in which a lost hand is looked for everywhere; in others it is where it was, or nowhere."""
    row = 1 + len(list(takewhile(lambda r: not r.fits, reversed(previous))))
    lost = bool(previous) and previous[-1].status == Status.LOST
    return lost and (_is_due(row) or row % UNSEEN_EVERY == 0)


def _is_due(row: int) -> bool:
    return row & (row - 1) == 0
