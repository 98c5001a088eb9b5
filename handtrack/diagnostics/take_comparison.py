"""How far two trackings of the same frames differ."""

from __future__ import annotations

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.tracking.frame.result import TrackResult


def compared(first: TrackResult, second: TrackResult) -> dict[str, float | int | None]:
    """Return how many frames both have, how far their joints of equal name lie apart there [mm], and their median energies.

    Raises HandtrackError where there is nothing to compare.
    """
    frames, a, b = np.intersect1d(first.frame, second.frame, return_indices=True)
    names = [name for name in first.joint_names if name in second.joint_names]
    if not len(frames) or not names:
        what = "frame" if not len(frames) else "joint"
        raise HandtrackError(
            f"the two takes have no {what} in common, so there is nothing to compare."
        )
    one = first.joint_positions[a][:, [first.joint_names.index(name) for name in names]]
    other = second.joint_positions[b][:, [second.joint_names.index(name) for name in names]]
    apart = 1e3 * np.linalg.norm(one - other, axis=2)
    worst = int(apart.mean(axis=1).argmax())
    return {
        "frames_of_both": len(frames),
        "distance_mm": float(apart.mean()),
        "distance_max_mm": float(apart.max()),
        "furthest_frame": int(frames[worst]),
        "energy_of_first": _median(first.energy[a]),
        "energy_of_second": _median(second.energy[b]),
    }


def _median(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None
