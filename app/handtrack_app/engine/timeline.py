"""Rows of the recording at a glance, kept from one look to the next: a frame is looked at again only where it changed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from handtrack.arrays import F, Floats, Ints, K, S
from handtrack.diagnostics.flexion import BENT_JOINTS
from handtrack.diagnostics.review import probability_off
from handtrack.store.current_track import CurrentTrack, Head, TakeFrames
from handtrack.tracking.frame.result import Status
from handtrack_app.protocol.timeline import APART, PROBABILITY, VIEWS

_AT_ONCE = 100  # frames that are read whole at one look, about 20 ms


@dataclass(frozen=True, eq=False)
class WholeFrame:
    """What the timeline and the curves show of a tracked frame that only all of its arrays tell."""

    error_mm: float
    """NaN without truth"""
    values: Floats[S]
    """joint parameters [m, rad]"""
    std: Floats[S]
    other: Floats[S] | None = None
    """joint parameters in the take that is compared"""
    bent: Floats[K] | None = None
    """by how much the truth bends each joint of a hand more [rad]"""
    lanes: Mapping[str, float] = field(default_factory=dict)
    """numbers by the words of their lanes"""


Read = Callable[[int], WholeFrame]
"""reads a tracked frame"""
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
        self.lanes: dict[str, Floats[F]] = {}
        """other numbers likewise: PROBABILITY, VIEWS, and those of whole frames"""
        self.values: Floats[F, S] = np.zeros((count, 0))
        """joint parameters of the frames read so far [m, rad], NaN elsewhere"""
        self.std: Floats[F, S] = np.zeros((count, 0))
        self.other: Floats[F, S] = np.zeros((count, 0))
        """likewise of the take that is compared"""
        self.bent: Floats[F, K] = np.full((count, len(BENT_JOINTS)), np.nan)
        """by how much the truth bends each of BENT_JOINTS more [rad]"""
        self.compared: TakeFrames | None = None
        """the take that the track is compared with"""
        self.changed: set[int] = set()
        """rows that were not told yet"""
        self._known: dict[int, Head] = {}
        self._given: dict[int, tuple[Floats[S], float]] = {}
        self._track: CurrentTrack | None = None
        self._read: list[int] = []  # how many of each take's frames were looked at
        self._unread: dict[
            int, None
        ] = {}  # frames whose error is to be found yet: that needs all of them

    def follow(self, track: CurrentTrack, read: Read, parts: Parts) -> None:
        """Take the track as it is now. read: `read_more` does the rest of it. parts: of the energy, by
        their words, from those by the terms' names.
        """
        for frame in self._new(track):
            self._look(track, frame, parts)
        self.read_more(track, read)

    def heads(self) -> list[Head]:
        """Return what is known of the tracked frames without their arrays, ascending."""
        return [self._known[frame] for frame in sorted(self._known)]

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
            self._put(self.terms, word, row, cost)
        if np.isfinite(head.p_off_25mm) or head.status in (Status.DOUBTFUL, Status.LOST):
            self._put(self.lanes, PROBABILITY, row, probability_off(head))
        if head.views:
            self._put(self.lanes, VIEWS, row, head.views)

    def _put(self, lanes: dict[str, Floats[F]], word: str, row: int, value: float) -> None:
        if word not in lanes:
            lanes[word] = np.full(len(self.frames), np.nan)
        lanes[word][row] = value

    def given_error(
        self, frame: int, pose: Floats[S], error: Callable[[Floats[S]], float]
    ) -> float:
        """Return the error of a pose given at a frame [mm], found once."""
        known = self._given.get(frame)
        if known is None or known[0] is not pose:
            known = self._given[frame] = pose, error(pose)
        return known[1]

    def read_more(self, track: CurrentTrack, read: Read) -> bool:
        """Read more frames that were not read yet; return whether any is left."""
        for frame in list(islice(self._unread, _AT_ONCE)):
            del self._unread[frame]
            if frame in track:
                row, whole = frame - self.frames.start, read(frame)
                self.error_mm[row] = whole.error_mm
                for word, number in whole.lanes.items():
                    self._put(self.lanes, word, row, number)
                if self.values.shape[1] != len(whole.values):
                    shape = len(self.frames), len(whole.values)
                    self.values, self.std, self.other = (np.full(shape, np.nan) for _ in range(3))
                self.values[row], self.std[row] = whole.values, whole.std
                if whole.other is not None:
                    self.other[row] = whole.other
                if whole.bent is not None:
                    self.bent[row] = whole.bent
                self.changed.add(row)
        return bool(self._unread)

    def compare(self, take: TakeFrames | None) -> None:
        """Compare the track with a take, or with none; all frames are read again."""
        self.compared = take
        self.lanes.pop(APART, None)
        self.other[:] = np.nan
        self._unread = dict.fromkeys(self._known)

    @property
    def is_whole(self) -> bool:
        """Whether all frames were read."""
        return not self._unread

    def _forget(self, frame: int) -> None:
        self._unread.pop(frame, None)
        if self._known.pop(frame, None) is not None:
            row = frame - self.frames.start
            self.changed.add(row)
            self.status[row] = -1
            for values in (
                self.energy, self.error_mm, *self.terms.values(), *self.lanes.values(), self.values, self.std,
                self.other, self.bent,
            ):  # fmt: skip
                values[row] = np.nan
