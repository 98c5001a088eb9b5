"""A person's size and shape from chosen frames: the estimate of a whole recording without its motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.observation.observation import Observation
from handtrack.parallel import one_blas_thread
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.size.cameras import OUTLINE, CameraChanges
from handtrack.tracking.size.estimate import StoppedError, estimate_whole
from handtrack.tracking.size.person import SIZE_BANDS_MM, PersonChange, Subject
from handtrack.tracking.whole.likelihood import Recording, RecordingLikelihood, measured_outlines


@one_blas_thread
def fit_person(
    subject: Subject,
    model: ArticulatedModel,
    settings: TrackerSettings,
    seen: Sequence[Observation],
    poses: Sequence[Floats[P]],
    should_stop: Callable[[], bool] = lambda: False,
    report: Callable[[float], None] = lambda share: None,
) -> HandScale | None:
    """Return the person who explains frames best, from `model` on, with the poses moving along;
    None where they tell nothing of what is open, or when stopped.

    Parameters
    ----------
    seen, poses
        Ascending; solver parameters of each, already found.
    report
        Is called with the share that is done.
    """
    observed, current = {one.frame: replace(one, images=()) for one in seen}, np.array(poses)
    settings = settings.with_values({"tracker.smoothing": 0.0})
    gaps = np.diff([one.time_s for one in seen])
    seconds = float(np.median(gaps)) if len(gaps) else 1.0
    scale, cameras = None, CameraChanges.of(seen).finding(OUTLINE)
    for stage, band in enumerate(SIZE_BANDS_MM):
        places = [model.bones(pose).position.mean(axis=0) for pose in current]
        person = PersonChange.of(model, list(zip(seen, places, strict=True)), subject)
        if not person.count:
            return None
        narrowed = settings.with_values({"silhouettes.bands_mm": (band,)})
        recording = Recording(model, narrowed, lambda frame, bones: observed[frame])
        frames = RecordingLikelihood(
            recording, dict(zip(observed, current, strict=True)), seconds,
            cameras=cameras, person=person, follows=False, wide=stage + 1 < len(SIZE_BANDS_MM),
        )  # fmt: skip
        frames = replace(frames, outline_mm=measured_outlines(frames, list(observed), current))
        try:
            found = estimate_whole(
                frames, list(observed), current, should_stop,
                lambda share, stage=stage: report((stage + share) / len(SIZE_BANDS_MM)),
            )  # fmt: skip
        except StoppedError:
            return None
        assert found.scale is not None, "something is free"
        scale, current, cameras = found.scale, found.poses, found.cameras
        model = subject.build(scale)
    return scale
