"""A person's constants of linked abduction, A_i = c_i · spread, from poses. 2004 paper, section 3.4."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import F, Floats, S
from handtrack.errors import HandtrackError
from handtrack.model.articulated import FINGERS
from handtrack.tracking.frame.result import Status, TrackResult

_LEAST_RAD = np.deg2rad(5.0)
"""a hand whose index never spreads further says nothing of how fingers spread together"""
_SURE_RAD = np.deg2rad(10.0)
"""an abduction known no better than this is left out"""


@dataclass(frozen=True)
class Spread:
    """How one person's fingers spread together."""

    ratio: dict[str, float]
    """c by finger: its abduction is c · spread; the index' is 1"""
    frames: int
    """poses it was measured from"""
    residual_rad: float
    """what the linkage leaves of the abductions: root of the mean square [rad]"""
    explained: float
    """share of their squares that it explains; 1 with a single pose"""

    def settings(self) -> dict[str, float]:
        """Return the tracker's settings, for coupling 18."""
        return {f"model.spread_{finger}": round(c, 4) for finger, c in self.ratio.items()}


def measured_spread(names: Sequence[str], poses: Floats[F, S]) -> Spread:
    """Return the constants that explain poses best, joint parameters by `names`; one flat, spread hand will do.

    The line through zero with the least squared distance to the abductions: the paper's linkage has no offset.
    Raises HandtrackError where fingers are missing or never spread.
    """
    fingers = FINGERS[1:]
    wanted = [f"{finger}_mcp_abd" for finger in fingers]
    if any(name not in names for name in wanted):
        raise HandtrackError(
            f"measuring the spread: expected a hand with {', '.join(wanted)}; this one has no such fingers."
        )
    angles = np.atleast_2d(poses)[:, [list(names).index(name) for name in wanted]]
    widest = float(np.abs(angles[:, 0]).max(initial=0.0))
    if widest < _LEAST_RAD:
        raise HandtrackError(
            f"measuring the spread: in these {len(angles)} frames the index spreads by {np.rad2deg(widest):.1f}° at most, "
            f"expected {np.rad2deg(_LEAST_RAD):g}° or more. Record a flat hand with its fingers spread."
        )
    along = np.linalg.svd(angles, full_matrices=False)[2][0]
    ratio = along / along[0]
    left = angles - np.outer(angles @ along, along)
    return Spread(
        dict(zip(fingers, ratio.tolist(), strict=True)),
        len(angles),
        float(np.sqrt((left**2).mean())),
        float(1.0 - (left**2).sum() / (angles**2).sum()),
    )


def spread_of_track(track: TrackResult) -> Spread:
    """Return the constants of a tracked recording: of its frames that were tracked, with abductions that were seen."""
    names = list(track.parameter_names)
    at = [names.index(f"{f}_mcp_abd") for f in FINGERS[1:] if f"{f}_mcp_abd" in names]
    sure = (track.parameter_std[:, at] < _SURE_RAD).all(axis=1)
    good = sure & np.isin(track.status, (Status.TRACKED, Status.KEYFRAME))
    if at and not good.any():
        raise HandtrackError(
            f"measuring the spread: in none of the {len(track)} frames all four abductions are known to within "
            f"{np.rad2deg(_SURE_RAD):g}°. Record a flat hand with its fingers spread, seen from the front or the back."
        )
    return measured_spread(names, track.parameters[good])
