"""Tracks: all frames with poses set by hand as one; a track file where nothing can be written."""

from __future__ import annotations

import io
import json
import logging
import tempfile
import threading
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.export.registry import ExportFormat, export_format
from handtrack.export.table import ResultsTable
from handtrack.session.formats.tables import read_npz
from handtrack.session.layout import POSES_FILE
from handtrack.store.current_track import TakeFrames
from handtrack.tracking.frame.result import FrameResult, Status, TrackResult
from handtrack_app.engine.document import Document
from handtrack_app.protocol.snapshots import Download, Notice

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


FIRST_POSE = "init"


def export_beside(
    document: Document,
    kind: str,
    client_id: int,
    up: str,
    publish: Callable[[Download | Notice], None],
) -> threading.Thread | None:
    """Send a file to the client that asked: the pose that is shown, or what has been tracked so far, which is taken now and
    written by the thread that is returned. Raises HandtrackError where there is nothing to send.
    """
    stem = file_stem(document)
    if kind == FIRST_POSE:
        name, data = first_pose_file(document)
        publish(Download(name, data, client_id))
        return None
    chosen = export_format(kind)
    table = ResultsTable(whole_track(document), "this track", document.run.session.folder)

    def work() -> None:
        try:
            name, data = exported(chosen, table, stem, up)
            publish(Download(name, data, client_id))
        except HandtrackError as error:
            publish(Notice("error", "Not exported", str(error)))
        except Exception as error:  # the page must go on, and the user must know
            log.exception("internal error")
            publish(Notice.of_mistake(error))

    thread = threading.Thread(target=work, name="export", daemon=True)
    thread.start()
    return thread


def exported(
    chosen: ExportFormat, table: ResultsTable, stem: str, up: str = ""
) -> tuple[str, bytes]:
    """Return name and content of one file: a zip where the format is of several. Raises HandtrackError."""
    with tempfile.TemporaryDirectory() as folder:
        written = chosen.write(Path(folder) / f"{stem}{chosen.ending}", table, up)
        if not chosen.has_parts:
            return written[0].name, written[0].read_bytes()
        data = io.BytesIO()
        with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in written:
                archive.write(path, path.name)
        return f"{written[0].stem}.zip", data.getvalue()


def first_pose_file(document: Document) -> tuple[str, bytes]:
    """Return name and content of the pose that is shown, as init.json."""
    values = dict(zip(document.model.parameter_names, document.shown.tolist(), strict=True))
    text = json.dumps({"frame": document.frame, "parameters": values}, indent=1) + "\n"
    return f"{file_stem(document)}_frame{document.frame}_init.json", text.encode()


def file_stem(document: Document) -> str:
    """Return the session's name as files may have it."""
    name = document.run.session.name
    return "".join(c if c.isalnum() else "_" for c in name).strip("_") or "session"
