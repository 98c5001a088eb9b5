"""How well a pose explains a frame: overlap in each camera, energy by term. Of any pose, tracked or set by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, P, evenly_spread, indices
from handtrack.diagnostics.metrics import known_median
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Observation, Silhouette
from handtrack.terms.silhouettes import outline_overlap
from handtrack.tracking.frame.descent import stage_problem
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import FrameResult, TrackResult
from handtrack.tracking.frame.settings import TrackerSettings


def score(
    model: ArticulatedModel, settings: TrackerSettings, seen: Observation, params: Floats[P]
) -> tuple[dict[str, float], dict[str, float]]:
    """Return what solver parameters are worth in a frame; empty where nothing was seen.

    By camera, the overlap of model and mask: their common area by that of both, 0 to 1. By term, the energy ½ Σ r² in the
    narrowest band; without any pull to a prediction, and without pins: a pose from before them would be blamed for what a
    person said after it.
    """
    bones = model.bones(params)
    terms = frame_terms(model, settings, replace(seen, pins=()), bones)
    if not terms.has_observations:
        return {}, {}
    overlap = dict[str, float]()
    if terms.prepared:
        shares = outline_overlap(terms.prepared, model.ellipsoids["fine"], bones).iou.tolist()
        names = [prepared.camera.name for prepared in terms.prepared]
        overlap = dict(zip(names, shares, strict=True))
    energy = stage_problem(terms, params).costs(params)
    return overlap, {name: float(cost) for name, cost in energy.items()}


# ---- How far two trackings of the same frames differ


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
