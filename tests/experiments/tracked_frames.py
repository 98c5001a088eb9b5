"""What experiments share: tracking a sequence, joint errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from handtrack import ArticulatedModel, FrameResult, Observation, Tracker, TrackerSettings
from handtrack.arrays import D3, Axes, Floats, P
from handtrack.tracking.sequence import track_frames


def tracked(
    model: ArticulatedModel,
    settings: Mapping[str, object] | TrackerSettings,
    seen: Sequence[Observation],
    start: Floats[P],
) -> list[FrameResult]:
    """Return frames 0, 1, … tracked from solver parameters on, with settings that differ from the defaults."""
    if not isinstance(settings, TrackerSettings):
        settings = TrackerSettings().with_values(settings)
    tracker = Tracker(model, settings)
    return list(track_frames(tracker, lambda frame, *_: seen[frame], 0, start, range(len(seen))))


def mean_mm(found: Floats[*Axes, D3], true: Floats[*Axes, D3]) -> float:
    """Return the mean distance between points [m], in mm."""
    return 1e3 * float(np.linalg.norm(found - true, axis=-1).mean())


def joint_error_mm(model: ArticulatedModel, params: Floats[P], truth: Floats[P]) -> float:
    """Return the mean distance of all joints and fingertips between two poses [mm]."""
    found, true = (model.joint_positions(model.bones(x)) for x in (params, truth))
    return mean_mm(found, true)
