"""The take of a tracking, frame by frame as it comes: durable, resumed where an interrupted run of the same left it."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from itertools import chain, takewhile
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.files.atomic import remove_abandoned, replacing
from handtrack.files.versions import keep_version
from handtrack.session.formats.tables import read_npz, write_npz
from handtrack.session.layout import POSES_FILE, TRACKS_FOLDER
from handtrack.session.run import TrackingRun
from handtrack.session.takes.take_about import about_refined, about_take
from handtrack.store.spans import Span
from handtrack.store.store import WritableStore
from handtrack.store.take import TakeAbout, TakeWriter
from handtrack.tracking.frame.result import FrameResult, Step, TrackLabels, TrackResult


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
        store.make_current(spans, words)
    store.know_file(file_digest(path))


def file_digest(path: Path) -> str:
    """Return what tells a file's content from any other."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


def _imported(store: WritableStore, track: TrackResult) -> int:
    first, stop = int(track.frame[0]), int(track.frame[-1]) + 1
    now = datetime.now(UTC).isoformat(timespec="seconds")
    writer = store.begin(TakeAbout(POSES_FILE, now, (first, stop), track.labels))
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
