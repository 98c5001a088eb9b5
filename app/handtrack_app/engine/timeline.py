"""Rows of the recording at a glance, kept from one look to the next: a frame is looked at again only where it changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import islice

import numpy as np

from handtrack.arrays import F, Floats, Ints
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
        self._known: dict[int, Head] = {}
        self._unread: dict[
            int, None
        ] = {}  # frames whose error is to be found yet: that needs all of them

    def follow(self, track: CurrentTrack, error: Error, parts: Parts) -> None:
        """Take the track as it is now. error: `read_errors` finds what is left of it. parts: of the energy, by
        their words, from those by the terms' names.
        """
        known, shown = self._known, set[int]()
        for frame in track:
            head = track.head(frame)
            if head is None or frame not in self.frames:
                continue
            shown.add(frame)
            if known.get(frame) is head:
                continue
            self._forget(frame)
            row = frame - self.frames.start
            known[frame] = head
            self.status[row], self.energy[row] = int(head.status), head.energy
            self._unread[frame] = None
            for word, cost in parts(head.energies).items():
                if word not in self.terms:
                    self.terms[word] = np.full(len(self.frames), np.nan)
                self.terms[word][row] = cost
        for frame in known.keys() - shown:
            self._forget(frame)
        self.read_errors(track, error, _AT_ONCE)

    def read_errors(self, track: CurrentTrack, error: Error, most: int) -> bool:
        """Find the error of frames that lack it, so many at most; return whether any is left."""
        for frame in list(islice(self._unread, most)):
            del self._unread[frame]
            if frame in track:
                self.error_mm[frame - self.frames.start] = error(frame)
        return bool(self._unread)

    def _forget(self, frame: int) -> None:
        self._unread.pop(frame, None)
        if self._known.pop(frame, None) is not None:
            row = frame - self.frames.start
            self.status[row] = -1
            for values in (self.energy, self.error_mm, *self.terms.values()):
                values[row] = np.nan
