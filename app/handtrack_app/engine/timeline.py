"""Rows of the recording at a glance, kept from one look to the next: a frame is looked at again only where it changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from handtrack.arrays import F, Floats, Ints
from handtrack.tracking.frame.result import FrameResult

Error = Callable[[FrameResult], float]
Parts = Callable[[FrameResult], Mapping[str, float]]


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
        self._known: dict[int, FrameResult] = {}

    def follow(self, results: Mapping[int, FrameResult], error: Error, parts: Parts) -> None:
        """Take the results as they are now. error: [mm] of a result; parts: of its energy, by their words."""
        known = self._known
        for frame in [f for f in known if f not in results]:
            self._forget(frame)
        for frame, result in results.items():
            if known.get(frame) is not result and frame in self.frames:
                self._forget(frame)
                row = frame - self.frames.start
                known[frame] = result
                self.status[row], self.energy[row] = int(result.status), result.energy
                self.error_mm[row] = error(result)
                for word, cost in parts(result).items():
                    if word not in self.terms:
                        self.terms[word] = np.full(len(self.frames), np.nan)
                    self.terms[word][row] = cost

    def _forget(self, frame: int) -> None:
        if self._known.pop(frame, None) is not None:
            row = frame - self.frames.start
            self.status[row] = -1
            for values in (self.energy, self.error_mm, *self.terms.values()):
                values[row] = np.nan
