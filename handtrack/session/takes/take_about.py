"""What a take is made from: settings, first pose, and the files that are read, so that the same can be gone on with."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from datetime import UTC, datetime
from hashlib import blake2b
from importlib.metadata import PackageNotFoundError, version
from math import isclose
from pathlib import Path
from typing import Any

from handtrack.arrays import Floats, P
from handtrack.capture.calibration.rig_file import rig_json
from handtrack.errors import HandtrackError
from handtrack.session.layout import CALIBRATION_FILE, SESSION_FILE, matching_files, place_of
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.store.store import Store
from handtrack.store.take import TakeAbout
from handtrack.tracking.frame.result import TrackLabels, TrackResult
from handtrack.version import VERSION

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


def about_refined(about: TakeAbout, labels: TrackLabels) -> TakeAbout:
    """Return the description of the refined frames of a take; labels: refining may change what they mean, as the hand's size."""
    inputs, by = {**about.inputs, "estimate": REFINED}, refined_by(about.by)
    return replace(about, by=by, begun=_now(), inputs=inputs, labels=labels)


def files_read(session: Session) -> dict[str, str]:
    """Return a digest of everything that is read of a session, by what it is; in two words where only the first must stay for
    tracked poses to be this recording's.

    Settings count by their contents; of recordings name, size and time of writing do: they may be large. A copy of the folder has
    other times, and session.toml may say the same in another way: these are the second words.
    """
    folder, file = session.folder, session.file
    # not its name, nor how it is tracked, which a take says itself
    parts = (
        replace(file.session, name="-"),
        *file.cameras,
        file.clouds,
        file.hand.model,
        file.hand.side,
    )
    said = json.dumps([*map(_said, parts)], sort_keys=True, default=str)
    found = {
        SESSION_FILE: f"{_digest(said)} {_content(folder / SESSION_FILE)}",
        CALIBRATION_FILE: f"{_digest(rig_json(session.rig))} {_content(folder / CALIBRATION_FILE)}",
    }
    recording, clouds = file.session, file.clouds
    for name, setting in (
        ("timestamps", recording.timestamps),
        ("clouds", None if clouds is None else clouds.files),
        *(
            (f"{what} of {camera.name}", setting)
            for camera in file.cameras
            for what in ("images", "masks", "depth", "keypoints")
            if isinstance(setting := getattr(camera, what), str)
        ),
    ):
        if setting is not None:
            with suppress(HandtrackError):  # none there
                files = matching_files(folder, setting, name)
                known = [(place_of(path, folder), path.stat()) for path in files]
                sizes = _digest(*(f"{name} {s.st_size}\n" for name, s in known))
                times = _digest(*(f"{name} {s.st_mtime_ns}" for name, s in known))
                found[name] = f"{sizes} {times}"
    return found


def foreign_takes(
    store: Store, session: Session, now: Mapping[str, str] | None = None
) -> list[str]:
    """Return a sentence for those takes of the current track that were not made from what the
    session holds now.

    Parameters
    ----------
    now
        Its `files_read`, where they are known.
    """
    by_change, now = dict[tuple[str, ...], list[int]](), now or files_read(session)
    for number in sorted({span.take for span in store.current()}):
        with suppress(HandtrackError):  # damaged: that is told
            about = store.take(number).about
            changed = _changed(about.inputs, about.labels.cameras, session, now)
            if changed:
                by_change.setdefault(changed, []).append(number)
    return [
        _foreign_words(
            f"take{'' if len(n) == 1 else 's'} {_listed([*map(str, n)])} of the current track",
            changed,
        )
        for changed, n in by_change.items()
    ]


def foreign_result(track: TrackResult, what: str, session: Session) -> list[str]:
    """Return a sentence where a result was made with other cameras than the session has now. what: the result's place."""
    changed = _changed({}, track.cameras, session, {})
    return [_foreign_words(what, changed)] if changed else []


def _changed(
    inputs: Mapping[str, str], cameras: str | None, session: Session, now: Mapping[str, str]
) -> tuple[str, ...]:
    changed = []
    if cameras is not None and not _same_cameras(cameras, session):
        changed.append(CALIBRATION_FILE)
    for name, digest in now.items():
        was = inputs.get(name, digest)
        two_words = (" " in digest and " " in was) or (" " not in digest and " " not in was)
        if two_words and was.split()[0] != digest.split()[0]:
            changed.append(name)
    return tuple(dict.fromkeys(changed))


def _same_cameras(text: str, session: Session) -> bool:
    try:
        return _is_close(json.loads(text), json.loads(rig_json(session.rig)))
    except ValueError:
        return True  # of another version: nothing can be said


def _is_close(one: Any, other: Any) -> bool:
    """Return whether two values of JSON are the same but for the rounding of numbers that were written and read."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_is_close(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_is_close, one, other))
    if isinstance(one, float | int) and isinstance(other, float | int):
        return isclose(one, other, rel_tol=1e-9, abs_tol=1e-9)
    return bool(one == other)


def _foreign_words(what: str, changed: Sequence[str]) -> str:
    return (
        f"{what}: made from other input than this session has now; changed: {_listed(changed)}. Its poses do not belong to "
        "the recording as it is. Track again, or put back the files that it was made from."
    )


def _listed(words: Sequence[str]) -> str:
    *before, last = words
    return f"{', '.join(before)} and {last}" if before else last


def _said(value: Any) -> Any:
    """Return a setting as plain values, those left out that are as usual: a later version may know more."""
    if not is_dataclass(value) or isinstance(value, type):
        return value
    given = {entry.name: (getattr(value, entry.name), entry.default) for entry in fields(value)}
    table = {name: _said(now) for name, (now, usual) in given.items() if now != usual}
    return {type(value).__name__: table}


def _content(file: Path) -> str:
    return _digest(file.read_bytes()) if file.is_file() else "-"


def _digest(*parts: str | bytes) -> str:
    total = blake2b(digest_size=8)
    for part in parts:
        total.update(part.encode() if isinstance(part, str) else part)
        total.update(b"\0")
    return total.hexdigest()


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


# ---- Which versions of the programs are in use


def versions_in_use() -> dict[str, str]:
    """Return the versions of the programs that make a take."""
    versions = {name: version_of(name) for name in ("numpy", "numba")}
    return {"handtrack": VERSION} | versions | {"python": platform.python_version()}


def version_of(name: str) -> str:
    """Return a package's version; `unknown` where it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"
