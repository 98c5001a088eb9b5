"""What a take is made from: settings, first pose, and the files that are read, so that the same can be gone on with."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from datetime import UTC, datetime
from hashlib import blake2b
from pathlib import Path

from handtrack.arrays import Floats, P
from handtrack.session.layout import CALIBRATION_FILE, SESSION_FILE, matching_files, place_of
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.takes.versions import versions_in_use
from handtrack.store.take import TakeAbout
from handtrack.tracking.frame.result import TrackLabels

REFINED = "refined"


def about_take(
    run: TrackingRun, by: str, frames: range, start_frame: int, start_params: Floats[P]
) -> TakeAbout:
    """Return the description of a take that is to be tracked. by: the program, such as `handtrack track`."""
    labels = run.labels
    start = {"frame": start_frame, "parameters": start_params.tolist()}
    points = None if run.first is None or run.first.xyz is None else run.first.xyz.tolist()
    given = {"keypoints": points, "forearm": run.forearm}
    versions = versions_in_use()
    asked = {
        "frames": f"{frames.start}:{frames.stop}",
        "first pose": _digest(json.dumps(start), json.dumps(given)),
        "settings": _digest(labels.settings),
        "hand": _digest(
            labels.definition or labels.model, labels.side, labels.scale, *labels.parameter_names
        ),
        "versions": " ".join(versions.values()),
    }
    return TakeAbout(
        by=by,
        begun=_now(),
        frames=(frames.start, frames.stop),
        labels=labels,
        inputs=asked | files_read(run.session),
        start=start,
        keyframes=(start_frame,),
        versions=versions,
    )


def refined_by(program: str) -> str:
    """Return what a take is said to be by that holds the frames of another one, refined together."""
    return f"{program}, {REFINED}"


def about_refined(about: TakeAbout, labels: TrackLabels | None = None) -> TakeAbout:
    """Return the description of the refined frames of a take; labels: where refining changed what they mean, as the hand's size."""
    inputs, by = {**about.inputs, "estimate": REFINED}, refined_by(about.by)
    return replace(about, by=by, begun=_now(), inputs=inputs, labels=labels or about.labels)


def files_read(session: Session) -> dict[str, str]:
    """Return a digest of everything that is read of a session, by what it is.

    Settings count by their contents; of recordings name, size and time of writing do: they may be large.
    """
    read = session.folder / SESSION_FILE, session.folder / CALIBRATION_FILE
    found = {path.name: _digest(path.read_bytes()) for path in read}
    recording, clouds = session.file.session, session.file.clouds
    for name, setting in (
        ("timestamps", recording.timestamps),
        ("clouds", None if clouds is None else clouds.files),
        *(
            (f"{what} of {camera.name}", setting)
            for camera in session.file.cameras
            for what in ("images", "masks", "depth", "keypoints")
            if isinstance(setting := getattr(camera, what), str)
        ),
    ):
        if setting is not None:
            found[name] = _stamps(session.folder, matching_files(session.folder, setting, name))
    return found


def _stamps(folder: Path, files: Iterable[Path]) -> str:
    known = ((path, path.stat()) for path in files)
    return _digest(*(f"{place_of(p, folder)} {s.st_size} {s.st_mtime_ns}\n" for p, s in known))


def _digest(*parts: str | bytes) -> str:
    total = blake2b(digest_size=8)
    for part in parts:
        total.update(part.encode() if isinstance(part, str) else part)
        total.update(b"\0")
    return total.hexdigest()


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
