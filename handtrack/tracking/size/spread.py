"""A person's constants of linked abduction, A_i = c_i · spread, from poses. 2004 paper, section 3.4."""

from __future__ import annotations

from typing import Any

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.model.articulated import FINGERS
from handtrack.tracking.frame.result import Status, TrackResult

_LEAST_RAD = np.deg2rad(5.0)
"""a hand whose index never spreads further says nothing of how fingers spread together"""
_SURE_RAD = np.deg2rad(10.0)
"""an abduction known no better than this is left out"""


def spread_of_track(track: TrackResult) -> dict[str, Any]:
    """Return the constants of a tracked recording, by its frames that were tracked, with abductions that were seen; one flat, spread hand will do.

    The line through zero with the least squared distance to the abductions: the paper's linkage has no offset.

    Returns
    -------
    dict
        `settings` of the tracker for coupling 18: c by finger, the index' is 1; the `frames` it was measured from; what the linkage leaves of
        the abductions, `residual_rad`, the root of the mean square; and the share of their squares that is `explained`.

    Raises
    ------
    HandtrackError
        Where fingers are missing, unknown or never spread.
    """
    names, fingers = list(track.parameter_names), FINGERS[1:]
    wanted = [f"{finger}_mcp_abd" for finger in fingers]
    if any(name not in names for name in wanted):
        raise HandtrackError(
            f"measuring the spread: expected a hand with {', '.join(wanted)}; this one has no such fingers."
        )
    at = [names.index(name) for name in wanted]
    sure = (track.parameter_std[:, at] < _SURE_RAD).all(axis=1)
    good = sure & np.isin(track.status, (Status.TRACKED, Status.KEYFRAME))
    if not good.any():
        raise HandtrackError(
            f"measuring the spread: in none of the {len(track)} frames all four abductions are known to within "
            f"{np.rad2deg(_SURE_RAD):g}°. Record a flat hand with its fingers spread, seen from the front or the back."
        )
    angles = track.parameters[good][:, at]
    widest = float(np.abs(angles[:, 0]).max())
    if widest < _LEAST_RAD:
        raise HandtrackError(
            f"measuring the spread: in these {len(angles)} frames the index spreads by {np.rad2deg(widest):.1f}° at most, "
            f"expected {np.rad2deg(_LEAST_RAD):g}° or more. Record a flat hand with its fingers spread."
        )
    along = np.linalg.svd(angles, full_matrices=False)[2][0]
    ratio = (along / along[0]).round(4).tolist()
    left = angles - np.outer(angles @ along, along)
    return {
        "settings": {f"model.spread_{finger}": c for finger, c in zip(fingers, ratio, strict=True)},
        "frames": len(angles),
        "residual_rad": float(np.sqrt((left**2).mean())),
        "explained": float(1.0 - (left**2).sum() / (angles**2).sum()),
    }
