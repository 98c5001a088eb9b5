"""The take that `handtrack track` makes, frame by frame, or goes on with where an earlier run of the same command left it."""

from __future__ import annotations

import argparse
import shutil
from contextlib import suppress
from dataclasses import replace
from itertools import chain, takewhile
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.files.atomic import remove_abandoned
from handtrack.session.layout import POSES_FILE, TRACKS_FOLDER
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.takes.take_about import about_refined, about_take
from handtrack.session.takes.track_files import file_digest, import_track
from handtrack.store.spans import Span
from handtrack.store.store import WritableStore
from handtrack.store.take import TakeWriter
from handtrack.tracking.frame.result import FrameResult, TrackLabels, TrackResult
from handtrack.tracking.state import Step
from handtrack_app.commands.terminal.progress import say

_PROGRAM = "handtrack track"
_STARTS = ("first pose", "hand")
_UNFINISHED = ".unfinished"


class TrackedTake:
    """The store of one run of the command; a context, in which no other program writes there.

    That is the session's, where its tracks/poses.npz is written. A result that goes elsewhere has a store of its own beside
    it until it is whole: so many may be made of one session at a time.
    """

    def __init__(self, out: Path, session: Session, args: argparse.Namespace) -> None:
        self._out, self._args = out, args
        self._session = session.folder
        self._own = out.resolve() != (session.folder / POSES_FILE).resolve()
        self._folder = session.folder / TRACKS_FOLDER
        if self._own:
            self._folder = out.with_name(out.name + _UNFINISHED)
        self._store: WritableStore | None = None
        self._passes: list[list[TakeWriter]] = []  # of each the frames as they came, and refined
        self._labels: TrackLabels | None = None
        self._finished = False

    def __enter__(self) -> TrackedTake:
        if not self._own:
            self._open()  # before hours of work that could not be saved
        return self

    def _open(self) -> None:
        self._store = WritableStore(self._folder, _PROGRAM, self._args.take_over)
        for folder in (self._folder, *(() if self._own else (self._session,))):
            remove_abandoned(folder)  # the lease is ours: nobody else writes there

    def __exit__(self, *_: object) -> None:
        if self._store is None:
            return
        self._store.close()
        if self._own and self._finished:
            shutil.rmtree(self._folder, ignore_errors=True)

    def begin(self, run: TrackingRun, frames: range) -> list[Step]:
        """Begin a take, or go on with one; return the frames that are there, in the order of tracking."""
        if self._store is None and (self._out.is_file() or not self._out.exists()):
            self._open()
        if self._store is None:
            return []  # a device keeps nothing
        if not self._own and (text := import_track(self._store, run.session.folder)):
            say(f"note: {text}")
        self._labels = None
        about = about_take(run, _PROGRAM, frames, *run.initial())
        left = None if self._args.restart else self._store.unfinished(about.inputs)
        if left is None:
            self._passes.append([self._store.begin(about)])
            return []
        for text in left.damage:
            say(f"note: {text}")
        steps = left.steps()
        done = [*takewhile(lambda step: step.result.frame != self._args.explain, steps)]
        self._passes.append([self._store.go_on(left)])
        count = sum(step.result.frame in frames for step in done)
        if count:
            more = f"(take {left.number}; --restart begins anew)"
            say(f"resuming at frame {count} of {len(frames)} {more}")
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

    def replace(self, result: FrameResult) -> None:
        """Keep the pose that all frames together chose, in a take of its own: what came first stays."""
        if self._store is None or not self._passes:
            return
        latest = self._passes[-1]
        if len(latest) == 1:
            about = about_refined(latest[0].about, self._labels)
            left = self._store.unfinished(about.inputs)
            latest.append(self._store.begin(about) if left is None else self._store.go_on(left))
        latest[-1].replace(result)

    def refined_with(self, labels: TrackLabels) -> None:
        """Say what the refined frames of the latest pass are: what they share, and of a hand of which size."""
        self._labels = labels

    def leave_pass(self) -> None:
        """Leave the latest pass unfinished, for the same command to go on with: the one before it holds."""
        if len(self._passes) > 1:
            self._passes.pop()

    def check(self) -> None:
        """Raise HandtrackError when another program took over: what it writes is not to be written over."""
        if self._store is not None:
            self._store.lease.check()

    def with_earlier(self, track: TrackResult) -> TrackResult:
        """Return what is to be saved of a tracking that did not come to its end: its frames over those that are current now.

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
        """Say that the result is written; finished: whether it is all of it, which replaces what was tracked before, as else its
        frames alone do. track: what this run tracked. It is current from now on.
        """
        if self._store is None or not self._passes:
            return
        if not self._own:
            self._store.know_file(file_digest(self._out))
            words = f"{_PROGRAM} of frames {track.frame[0]} to {track.frame[-1]}"
            self._store.make_current(self._spans(track, finished), words)
        if finished:
            for writer in chain(*self._passes):  # not before: the later follow from the earlier
                writer.finish()
            self._finished = True
