"""How far two trackings of the same frames differ."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from handtrack.arrays import evenly_spread, indices
from handtrack.diagnostics.metrics import known_median
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Silhouette
from handtrack.terms.silhouettes.outline_overlap import outline_overlap
from handtrack.tracking.frame.result import FrameResult, TrackResult

_LOOKED_AT = 50  # frames; a mean of so many shows a difference between takes


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
    one = first.joint_positions[a][:, indices(first.joint_names, names)]
    other = second.joint_positions[b][:, indices(second.joint_names, names)]
    apart = 1e3 * np.linalg.norm(one - other, axis=2)
    worst = int(apart.mean(axis=1).argmax())
    return {
        "frames_of_both": len(frames),
        "distance_mm": float(apart.mean()),
        "distance_max_mm": float(apart.max()),
        "furthest_frame": int(frames[worst]),
        "energy_of_first": known_median(first.energy[a]),
        "energy_of_second": known_median(second.energy[b]),
    }


def mean_overlap(
    model: ArticulatedModel,
    seen: Callable[[int], Sequence[Silhouette]],
    frames: Sequence[FrameResult],
) -> float | None:
    """Return how well a track covers the masks: intersection over union, the mean of cameras and of
    frames, at most 50 that are evenly spread.

    None where there are none.

    Parameters
    ----------
    seen
        The silhouettes of a frame.
    """
    found = []
    for result in (frames[index] for index in evenly_spread(len(frames), _LOOKED_AT)):
        bones = model.bones(model.transform.solver_params(result.parameters))
        found += outline_overlap(seen(result.frame), model.ellipsoids["fine"], bones).iou.tolist()
    return float(np.mean(found)) if found else None
