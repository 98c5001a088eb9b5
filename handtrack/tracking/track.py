"""A sequence of observations, tracked in one call: what a session does, for arrays in memory."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation, check_kind
from handtrack.parallel import one_blas_thread
from handtrack.terms.term import ObservationTerm, ParameterTerm
from handtrack.tracking.find_pose import find_first_pose
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import TrackLabels, TrackResult
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.sequence import track_recording
from handtrack.tracking.tracker import Tracker

_HOW = "Observation(frame, time_s, silhouettes=[Silhouette(camera, mask), …]), one a frame"


@one_blas_thread
def track(
    model: ArticulatedModel,
    observations: Iterable[Observation] | Observation,
    start: Floats[P] | None = None,
    settings: TrackerSettings = TrackerSettings(),
    terms: Sequence[ObservationTerm] = (),
    priors: Sequence[ParameterTerm] = (),
    control: Control = Control(),
) -> TrackResult:
    """Return the tracked sequence: frame after frame, then refined together as the settings say.

    Parameters
    ----------
    observations
        In any order, each frame once, or a single one; frames between that are missing are frames
        in which nothing was seen.
    start
        Solver parameters of the first frame; found by itself where None (hands only).
    terms, priors
        Costs of one's own, of bone poses and of joint parameters
        (docs/contributing/adding_a_term.md).

    Raises
    ------
    HandtrackError
        Where there is nothing to track, or no first pose is found.
    """
    tracker = Tracker(model, settings, terms, priors)
    several = isinstance(observations, Iterable)
    given = list(observations) if several else [observations]
    for seen in given:
        check_kind(seen, Observation, "observations", _HOW)
    by_frame = {seen.frame: seen for seen in given}
    if len(by_frame) < len(given) or not by_frame:
        raise HandtrackError(
            f"{len(given)} observations of {len(by_frame)} frames; expected at least one, and each frame once. Give "
            "all views of a frame in one Observation."
        )
    numbers = np.array(sorted(by_frame))
    times = np.array([by_frame[number].time_s for number in numbers])
    if (np.diff(times) <= 0).any():
        row = int((np.diff(times) <= 0).argmax())
        raise HandtrackError(
            f"time_s of frames {numbers[row]} and {numbers[row + 1]}: {times[row]:g} and {times[row + 1]:g}; expected seconds that "
            "grow with the frame's number."
        )
    frames = range(int(numbers[0]), int(numbers[-1]) + 1)
    first, params, sure = frames.start, start, 1.0
    if params is not None:
        params = model.checked(params, "start")
    else:
        found = find_first_pose(
            model, [by_frame[number] for number in numbers], settings, control.should_stop
        )
        first, params, sure = found.frame, found.params, found.confidence

    def observe(frame: int, bones: BonePoses | None = None) -> Observation:
        missing = Observation(frame, float(np.interp(frame, numbers, times)))
        return by_frame.get(frame, missing)

    tracker = replace(tracker, start_confidence=sure)
    results = track_recording(tracker, observe, first, model.clipped(params), frames, control)
    labels = TrackLabels.of(model, settings=json.dumps(settings.flat(), sort_keys=True))
    return labels.track(results)
