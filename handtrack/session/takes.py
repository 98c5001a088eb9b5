"""Takes of a session: what each is made from, so that the same can be gone on with, and how a tracking becomes one."""

from __future__ import annotations

import hashlib
import json
import platform
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from itertools import chain, takewhile
from math import isclose
from pathlib import Path
from typing import Any

from handtrack.arrays import Floats, P
from handtrack.capture.calibration.rig_file import rig_json
from handtrack.errors import HandtrackError
from handtrack.files.atomic import keep_version, remove_abandoned, replacing
from handtrack.session.layout import (
    CALIBRATION_FILE,
    POSES_FILE,
    SESSION_FILE,
    TRACKS_FOLDER,
    matching_files,
    place_of,
)
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.tables import read_npz, write_npz
from handtrack.store.history import Span
from handtrack.store.store import Store, WritableStore
from handtrack.store.take import TakeAbout, TakeWriter
from handtrack.tracking.frame.result import FrameResult, Step, TrackLabels, TrackResult
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
    total = hashlib.blake2b(digest_size=8)
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


# ---- The take of a tracking, frame by frame as it comes: durable, resumed where an interrupted run of the same left it


def import_track(store: WritableStore, folder: Path) -> str:
    """Make a take of a session's track file that the store does not know, another program's say; say so. The file stays; of
    one that cannot be read is told, and no take made.
    """
    path = folder / POSES_FILE
    if (
        not path.is_file()
        or path.is_symlink()
        or (digest := file_digest(path)) in store.known_files()
    ):
        return ""
    try:
        number = _imported(store, read_npz(path))
    except HandtrackError as error:
        return f"{error} It is kept as it is in versions/ when it is written over."
    store.know_file(digest)
    return f"{path} is kept as take {number}."


def make_current(store: WritableStore, spans: Sequence[Span], words: str, path: Path) -> None:
    """Make spans of takes the current track, and write it to the session's track file: both, or neither where the disk is full.

    Raises HandtrackError where they cannot be one track, and OSError.
    """
    track = store.track_of(store.composed(spans))
    assert track is not None, "spans have frames"
    path.parent.mkdir(exist_ok=True)
    keep_version(path)
    with replacing(path) as part:
        write_npz(part, track)
        store.know_file(file_digest(part))
        store.make_current(spans, words)


def file_digest(path: Path) -> str:
    """Return what tells a file's content from any other."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


def _imported(store: WritableStore, track: TrackResult) -> int:
    first, stop = int(track.frame[0]), int(track.frame[-1]) + 1
    writer = store.begin(TakeAbout(POSES_FILE, _now(), (first, stop), track.labels))
    for result in track.frames():
        writer.replace(result)
    writer.finish()
    if not store.current():
        store.make_current([Span(writer.take.number, first, stop)])
    return writer.take.number


_STARTS = ("first pose", "hand")
_UNFINISHED = ".unfinished"


class TakeRecorder:
    """Where a tracking is kept; a context, in which no other program writes there.

    That is the session's store where the result is the session's tracks/poses.npz. A result elsewhere has a store of its own
    beside it until it is complete: several may be made of one session at a time.
    """

    def __init__(
        self,
        out: Path,
        session: Path,
        program: str,
        restart: bool,
        take_over: bool,
        resume_before: int | None,
        on_note: Callable[[str], object],
    ) -> None:
        """
        Parameters
        ----------
        out, session
            the result's file, and the session's folder
        program
            named in the take, and to other programs that want to write
        restart
            an interrupted run of the same is not resumed
        take_over
            take over the write lock of another program
        resume_before
            a frame that is to be tracked, and those after it, even if an interrupted run has it
        on_note
            called with what a person should know
        """
        self.out, self._session, self._program, self._restart = out, session, program, restart
        self._take_over, self._resume_before, self._note = take_over, resume_before, on_note
        self._own = out.resolve() != (session / POSES_FILE).resolve()
        self._folder = session / TRACKS_FOLDER
        if self._own:
            self._folder = out.with_name(out.name + _UNFINISHED)
        self._store: WritableStore | None = None
        self._passes: list[list[TakeWriter]] = []  # of each: forward, and refined
        self._finished = False

    def __enter__(self) -> TakeRecorder:
        if not self._own:
            self._open()  # before hours of work that could not be saved
        return self

    def _open(self) -> None:
        self._store = WritableStore(self._folder, self._program, self._take_over)
        for folder in (self._folder, *(() if self._own else (self._session,))):
            remove_abandoned(folder)  # the lease is ours: nobody else writes there

    def __exit__(self, *_: object) -> None:
        if self._store is None:
            return
        self._store.close()
        if self._own and self._finished:
            shutil.rmtree(self._folder, ignore_errors=True)

    def begin(self, run: TrackingRun, frames: range, posed: Mapping[str, str]) -> list[Step]:
        """Begin a pass, or resume one; return the frames that are there, in the order of tracking.

        Parameters
        ----------
        run, frames
            what is tracked
        posed
            digests of the poses it is tracked by, by their names: another pose is another pass
        """
        if self._store is None and (self.out.is_file() or not self.out.exists()):
            self._open()
        if self._store is None:
            return []  # a device keeps nothing
        if not self._own and (text := import_track(self._store, run.session.folder)):
            self._note(text)
        about = about_take(run, self._program, frames, *run.initial())
        about = replace(about, inputs={**about.inputs, **posed})
        left = None if self._restart else self._store.unfinished(about.inputs)
        if left is None:
            self._passes.append([self._store.begin(about)])
            return []
        for text in left.damage:
            self._note(text)
        end = self._resume_before
        done = [*takewhile(lambda step: step.result.frame != end, left.steps())]
        self._passes.append([self._store.go_on(left)])
        return done

    @property
    def is_first(self) -> bool:
        """Whether nothing was tracked to its end before from the same first pose with the same hand."""
        if self._store is None or not self._passes:
            return True
        own = self._passes[0][0].about.inputs
        for take in self._store.takes():
            with suppress(HandtrackError):  # nobody knows what it was made from
                made_from = take.about.inputs
                if all(made_from.get(key) == own[key] for key in _STARTS) and take.is_finished:
                    return False
        return True

    def add(self, step: Step) -> None:
        """Keep a tracked frame."""
        if self._passes:
            self._passes[-1][0].add(step)

    def refine(self, labels: TrackLabels, results: list[FrameResult]) -> None:
        """Keep refined frames, in a take of their own: what came first stays. labels: what their numbers mean."""
        if self._store is None or not self._passes:
            return
        latest = self._passes[-1]
        if len(latest) == 1:
            about = about_refined(latest[0].about, labels)
            left = self._store.unfinished(about.inputs)
            latest.append(self._store.begin(about) if left is None else self._store.go_on(left))
        for result in results:
            latest[-1].replace(result)

    def leave_pass(self) -> None:
        """Leave the latest pass unfinished, to be resumed: the one before it holds."""
        if len(self._passes) > 1:
            self._passes.pop()

    def check(self) -> None:
        """Raise HandtrackError when another program took over: what it writes is not to be written over."""
        if self._store is not None:
            self._store.lease.check()

    def with_earlier(self, track: TrackResult) -> TrackResult:
        """Return what is to be saved of an interrupted tracking: its frames over the current ones.

        Raises HandtrackError where these were tracked with another model: they stay.
        """
        store = self._store
        if store is None or self._own or not self._passes:
            return track
        frames = set(track.frame.tolist())
        if all(
            frame in frames for span in store.current() for frame in range(span.first, span.stop)
        ):
            return track  # nothing is left of what was there
        whole = store.track_of(store.composed(self._spans(track, finished=False)))
        return track if whole is None else replace(whole, pins=track.pins)

    @property
    def number(self) -> int | None:
        """The number of the latest take; None where there is none."""
        return self._passes[-1][-1].take.number if self._passes else None

    def _spans(self, track: TrackResult, finished: bool) -> list[Span]:
        first, last = int(track.frame[0]), int(track.frame[-1])
        new = [Span(writer.take.number, first, last + 1) for writer in self._passes[-1]]
        return new if finished or self._store is None else [*self._store.current(), *new]

    def saved(self, track: TrackResult, finished: bool) -> None:
        """Make what this run tracked current: its result is written. finished: it replaces all that was tracked before."""
        if self._store is None or not self._passes:
            return
        if not self._own:
            self._store.know_file(file_digest(self.out))
            words = f"{self._program} of frames {track.frame[0]} to {track.frame[-1]}"
            self._store.make_current(self._spans(track, finished), words)
        if finished:
            for writer in chain(*self._passes):  # not before: the later follow from the earlier
                writer.finish()
            self._finished = True
