"""Tracks: all frames with poses set by hand as one; a track file where nothing can be written."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from pathlib import Path

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.session.formats.tables import read_npz
from handtrack.session.layout import POSES_FILE
from handtrack.store.current_track import TakeFrames
from handtrack.tracking.frame.result import FrameResult, Status, TrackResult
from handtrack_app.engine.document import Document

log = logging.getLogger(__name__)


def whole_track(document: Document) -> TrackResult:
    """Return all frames as one TrackResult; poses set by hand are keyframes."""
    frames = dict(document.results)
    frames.update({frame: _keyframe(document, frame) for frame in document.by_hand})
    if not frames:
        raise HandtrackError(
            f"There is nothing to save yet: track some frames, or pose the {document.model.kind}, first."
        )
    track = document.run.result(sorted(frames.values(), key=lambda result: result.frame))
    return replace(track, refinement=document.results.refinement)


def _keyframe(document: Document, frame: int) -> FrameResult:
    model, values = document.model, np.asarray(document.by_hand[frame], dtype=float)
    bones = model.bones(model.transform.solver_params(values))
    return FrameResult(
        frame=frame,
        time_s=float(document.run.session.time_s(frame)),
        parameters=values,
        status=Status.KEYFRAME,
        energy=float("nan"),
        iterations=0,
        parameter_std=np.full(len(values), np.inf),
        joint_covariance=np.tile(np.eye(3), (len(model.joint_names), 1, 1)),
        T_world_bone=bones.T_world_bone,
        joint_positions=model.joint_positions(bones),
        keypoints21=model.keypoints21(bones) if model.has_keypoints21 else None,
    )


def track_file(folder: Path) -> TakeFrames | None:
    """Return the track file of a session's folder, to be shown where nothing can be written; None where it cannot be."""
    path = folder / POSES_FILE
    if not path.is_file():
        return None
    try:
        track = read_npz(path)
    except HandtrackError as error:
        log.warning("%s cannot be shown: %s", path, error)
        return None
    frames = {r.frame: r for r in track.frames()}
    return TakeFrames(
        track.parameter_names, dict(frames), settings=json.loads(track.settings or "{}")
    )
