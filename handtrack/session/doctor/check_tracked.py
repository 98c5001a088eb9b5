"""The doctor's look at what was tracked: whether it was made from what is there, and whether one camera contradicts the others, by its direction or its lens."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence

import numpy as np

from handtrack.model.model_file import scale_from
from handtrack.session.doctor.check_views import Finding, warning
from handtrack.session.formats.tables import read_npz
from handtrack.session.layout import POSES_FILE, TRACKS_FOLDER
from handtrack.session.run import TrackingRun, samples
from handtrack.session.session import Session
from handtrack.session.takes.take_about import foreign_result, foreign_takes
from handtrack.store.store import Store
from handtrack.tracking.frame.confidence import hand_words, odd_size
from handtrack.tracking.frame.result import FrameResult, Status
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
