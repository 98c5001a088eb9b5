"""Rows of the recording at a glance, kept from one look to the next: a frame is looked at again only where it changed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import islice

import numpy as np

from handtrack.arrays import F, Floats, Ints, S
from handtrack.store.current_track import CurrentTrack, Head

_AT_ONCE = 100  # frames whose error is found at one look, about 20 ms

Error = Callable[[int], float]
"""of a tracked frame [mm]"""
Parts = Callable[[Mapping[str, float]], Mapping[str, float]]


class TrackedRows:
    """What the timeline shows of tracked frames; rows are frames from `frames.start`."""

    def __init__(self, frames: range) -> None:
        count = len(frames)
        self.frames = frames
        self.status: Ints[F] = np.full(count, -1, dtype=np.int64)
        self.energy: Floats[F] = np.full(count, np.nan)
        self.error_mm: Floats[F] = np.full(count, np.nan)
        self.terms: dict[str, Floats[F]] = {}
        """the energy's parts by their words, NaN where a frame has none"""
        self.changed: set[int] = set()
        """rows that were not told yet"""
        self._known: dict[int, Head] = {}
        self._given: dict[int, tuple[Floats[S], float]] = {}
        self._track: CurrentTrack | None = None
        self._read: list[int] = []  # how many of each take's frames were looked at
        self._unread: dict[
            int, None
        ] = {}  # frames whose error is to be found yet: that needs all of them

    def follow(self, track: CurrentTrack, error: Error, parts: Parts) -> None:
        """Take the track as it is now. error: `read_errors` finds what is left of it. parts: of the energy, by
        their words, from those by the terms' names.
        """
        for frame in self._new(track):
            self._look(track, frame, parts)
        self.read_errors(track, error)

    def _new(self, track: CurrentTrack) -> Iterable[int]:
        """Return the frames that may have changed since the last look: all of another track, else those taken since."""
        takes = [take for _, take in track.layers]
        before = self._read if track is self._track else None
        self._track, self._read = track, [len(take.puts) for take in takes]
        if before is None:
            return [*self._known.keys() - (there := set(track)), *there]
        return [f for take, n in zip(takes, before, strict=True) for f in take.puts[n:]]

    def _look(self, track: CurrentTrack, frame: int, parts: Parts) -> None:
        head = track.head(frame)
        if head is not None and self._known.get(frame) is head:
            return
        self._forget(frame)
        if head is None or frame not in self.frames:
            return
        row = frame - self.frames.start
        self._known[frame] = head
        self.status[row], self.energy[row] = int(head.status), head.energy
        self._unread[frame] = None
        self.changed.add(row)
        for word, cost in parts(head.energies).items():
            if word not in self.terms:
                self.terms[word] = np.full(len(self.frames), np.nan)
            self.terms[word][row] = cost

    def given_error(
        self, frame: int, pose: Floats[S], error: Callable[[Floats[S]], float]
    ) -> float:
        """Return the error of a pose given at a frame [mm], found once."""
        known = self._given.get(frame)
        if known is None or known[0] is not pose:
            known = self._given[frame] = pose, error(pose)
        return known[1]

    def read_errors(self, track: CurrentTrack, error: Error) -> bool:
        """Find the error of more frames that lack it; return whether any is left."""
        for frame in list(islice(self._unread, _AT_ONCE)):
            del self._unread[frame]
            if frame in track:
                row = frame - self.frames.start
                self.error_mm[row] = error(frame)
                self.changed.add(row)
        return bool(self._unread)

    def _forget(self, frame: int) -> None:
        self._unread.pop(frame, None)
        if self._known.pop(frame, None) is not None:
            row = frame - self.frames.start
            self.changed.add(row)
            self.status[row] = -1
            for values in (self.energy, self.error_mm, *self.terms.values()):
                values[row] = np.nan
