"""The doctor's look at what was tracked: whether it was made from what is there, and whether one camera contradicts the others, by its direction or its lens."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from handtrack.arrays import Floats, P, S, evenly_spread
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import model_from_definition, scale_from
from handtrack.observation.observation import Observation
from handtrack.session.doctor.check_views import Finding, warning
from handtrack.session.formats.tables import read_npz
from handtrack.session.layout import POSES_FILE, TRACKS_FOLDER
from handtrack.session.run import TrackingRun, samples
from handtrack.session.session import Session
from handtrack.session.sources.clouds import hand_region
from handtrack.session.takes import foreign_result, foreign_takes
from handtrack.store.store import Store
from handtrack.tracking.frame.confidence import hand_words, odd_size
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.global_search import other_side_log_odds
from handtrack.tracking.size.camera_consistency import CameraInconsistency, camera_inconsistencies

_FEWEST, _SAMPLED = 4, 8  # frames, evenly spread
# log-likelihood, and share of what is left unexplained, that a camera's change must bring; measured on simulated scenes, and on
# recordings of hands of other shape (docs/explanation/trajectory.md). A detector errs alike in all images of one view, which looks like a
# turned camera: 0.14 on desk_two_view
_LEAST_GAIN, _LEAST_SHARE, _LEAST_SHARE_OF_JOINTS = (12.0, 0.05, 0.2)
_SIMILAR = 0.7  # of the gain: another camera that would do as well


def check_tracked_from(session: Session) -> Iterator[Finding]:
    """Yield that what was tracked was made from other input than the session has now."""
    found = foreign_takes(Store(session.folder / TRACKS_FOLDER), session)
    path = session.folder / POSES_FILE
    if not found and path.is_file():
        found = foreign_result(read_npz(path), str(POSES_FILE), session)
    yield from map(warning, found)


def check_tracked_cameras(session: Session) -> Iterator[Finding]:
    """Yield that one camera contradicts the others, where there is a result."""
    path = session.folder / POSES_FILE
    if not path.is_file():
        return
    track = read_npz(path)
    values = {"model.fit_size": "false"}
    run = TrackingRun.open(session, values, use_init=False)
    run = run.with_scale(scale_from(json.loads(track.scale), path))
    run = run.with_parameters(track.parameter_names)
    if run.model.parameter_names != track.parameter_names:
        return
    kept = [frame for frame in track.frames() if frame.frame in session.frame_range]
    text = inconsistency_of_cameras(run, kept)
    yield from [warning(f"{POSES_FILE}: {text}")] if text else []


def inconsistency_of_cameras(run: TrackingRun, results: Sequence[FrameResult]) -> str:
    """Return which camera the others contradict after tracking, in a sentence with figures; empty where none is to be blamed."""
    posed = [result for result in results if result.status != Status.LOST]
    if len(posed) < _FEWEST or len(run.session.views) < 2:
        return ""
    seen = [(one, params) for params, one in samples(run, posed, _SAMPLED)]
    found = camera_inconsistencies(run.model, run.settings, seen)
    least = _LEAST_SHARE_OF_JOINTS if any(one.keypoints for one, _ in seen) else _LEAST_SHARE
    if not found or found[0].gain < _LEAST_GAIN or found[0].share < least:
        return ""
    return _words(found, hand_words(run.model) if odd_size(run.model) else "")


def _words(found: Sequence[CameraInconsistency], odd: str) -> str:
    worst = found[0]
    others = [
        f"'{d.camera}'"
        for d in found[1:]
        if d.gain > _SIMILAR * worst.gain and d.kind == worst.kind
    ]
    or_others = f" (or {' or '.join(others)})" if others else ""
    share = f"{100 * worst.share:.0f} % of what is left unexplained would go"
    if worst.kind == "direction":
        found_in = f"turned by about {np.rad2deg(worst.turn_rad):.1f}°, {worst.off_px:.0f} px where it looks"
        asked = "Was it moved after the calibration, or are its rotation and translation another's?"
    else:
        found_in = f"with another lens, {worst.off_px:.1f} px different at the hand"
        asked = (
            "Did a coefficient, such as k3, get lost, or does the lens belong to another camera?"
        )
    too = f"; the {odd}" if odd else ""
    return (
        f"camera '{worst.camera}'{or_others} contradicts the others: {found_in}, {share}{too}. {asked} `handtrack calibrate` "
        "makes the calibration anew."
    )


# ---- Whether session.toml names the right side: told where what was tracked fits the other hand decisively better


_SIDE_SAMPLED = 4  # frames, evenly spread
_DECISIVE = 5.0  # log-odds, 150 to 1; docs/contributing/testing.md


def wrong_side_warning(
    session: Session,
    settings: TrackerSettings,
    model: ArticulatedModel,
    tracked: Mapping[int, Floats[S]],
    control: Control = Control(),
) -> str:
    """Return that the hand is the other one, in words; empty where that is not clear.

    A flat hand seen from afar is like the other one's back: nothing is told of it.

    Parameters
    ----------
    tracked
        Joint parameters by frame.
    """
    if model.kind != "hand" or not model.has_keypoints21 or not tracked:
        return ""
    frames = sorted(tracked)
    rows = evenly_spread(len(frames), _SIDE_SAMPLED)
    other_side = "left" if model.side == "right" else "right"
    other = model_from_definition(
        model.definition_text, other_side, model.scale, model.has_forearm, model.name
    )
    alone = settings.with_values({"tracker.hypotheses": 1})

    def posed() -> Iterator[tuple[Observation, Floats[P]]]:
        for frame in (frames[row] for row in rows):
            params = model.solver_params(tracked[frame])
            near = hand_region(model, model.bones(params))
            used = settings.silhouettes.weight > 0, settings.cloud.weight > 0
            yield session.observation(frame, *used, near), params

    odds = other_side_log_odds(model, other, alone, posed(), control)
    if odds < _DECISIVE:
        return ""
    return (
        f"a {other_side} hand fits the observations decisively better than a {model.side} one (log-odds {odds:.1f} in "
        f'{len(rows)} frames). Is side = "{model.side}" right in session.toml? If it is: are two cameras exchanged?'
    )
