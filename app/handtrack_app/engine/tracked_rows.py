"""What the timeline and the plots show of tracked frames, row by row, as far as it was read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from handtrack.arrays import F, Floats, Ints, K, S
from handtrack.diagnostics.metrics import BENT_JOINTS, flexion_deg
from handtrack.diagnostics.review import failure_probability
from handtrack.observation.truth import mean_error_mm
from handtrack.store.take import CurrentTrack, Head
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack_app.protocol.snapshots import COST, ERROR, MOVED, PROBABILITY, TERM, VIEWS

if TYPE_CHECKING:
    from handtrack_app.engine.document import Document

_AT_ONCE = 100  # frames that are read whole at one look, about 20 ms
TERM_WORDS = {
    "coverage": "silhouettes",
    "conic_field": "silhouettes",
    "cloud_distance": "cloud→model",
    "cloud_emptiness": "model→cloud",
    "cloud_rays": "lines of sight",
    "keypoints": "keypoints",
    "pins": "pins",
    "own": "own terms",
    "edges": "edges",
    "intensity": "intensity",
} | dict.fromkeys(
    (
        "rest",
        "posture",
        "motion",
        "keyframe",
        "stabilise",
        "stay",
        "collision",
        "proportions",
        "prior",
    ),
    "priors",
)
"""by the name of a term"""


class TrackedRows:
    """What the timeline shows of tracked frames; rows are frames from `frames.start`."""

    def __init__(self, frames: range) -> None:
        count = len(frames)
        self.frames = frames
        self.status: Ints[F] = np.full(count, -1, dtype=np.int64)
        self.lanes: dict[str, Floats[F]] = {}
        """numbers by their words, as of TimelineSnapshot; NaN where a frame has none"""
        self.values: Floats[F, S] = np.zeros((count, 0))
        """joint parameters of the frames read so far [m, rad], NaN elsewhere"""
        self.std: Floats[F, S] = np.zeros((count, 0))
        self.bent: Floats[F, K] = np.full((count, len(BENT_JOINTS)), np.nan)
        """by how much the truth bends each of BENT_JOINTS more [rad]"""
        self.changed: set[int] = set()
        """rows that were not told yet"""
        self._known: dict[int, Head] = {}
        self._track: CurrentTrack | None = None
        self._looked: list[int] = []  # at how many of each take's frames
        self._unread: dict[int, None] = {}
        """frames of which only what stands in their heads is known"""

    def follow(self, document: Document) -> None:
        """Take the track as it is now; `read_more` does the rest of it."""
        for frame in self._new(document.results):
            self._look(document.results, frame)
        self.read_more(document)

    def heads(self) -> list[Head]:
        """Return what is known of the tracked frames without their arrays, ascending."""
        return [self._known[frame] for frame in sorted(self._known)]

    def _new(self, track: CurrentTrack) -> Iterable[int]:
        """Return the frames that may have changed since the last look: all of another track, else those taken since."""
        takes = [take for _, take in track.layers]
        before = self._looked if track is self._track else None
        self._track, self._looked = track, [len(take.puts) for take in takes]
        if before is None:
            return [*self._known.keys() - (there := set(track)), *there]
        return [f for take, n in zip(takes, before, strict=True) for f in take.puts[n:]]

    def _look(self, track: CurrentTrack, frame: int) -> None:
        head = track.head(frame)
        if head is not None and self._known.get(frame) is head:
            return
        self._forget(frame)
        if head is None or frame not in self.frames:
            return
        row = frame - self.frames.start
        self._known[frame] = head
        self.status[row] = int(head.status)
        self._unread[frame] = None
        self.changed.add(row)
        self._put(COST, row, head.energy)
        for word, cost in cost_parts(head.energies).items():
            self._put(TERM + word, row, cost)
        if np.isfinite(head.p_off_25mm) or head.status in (Status.DOUBTFUL, Status.LOST):
            self._put(PROBABILITY, row, failure_probability(head))
        if head.views:
            self._put(VIEWS, row, head.views)

    def _put(self, word: str, row: int, value: float) -> None:
        if word not in self.lanes:
            self.lanes[word] = np.full(len(self.frames), np.nan)
        self.lanes[word][row] = value

    def read_more(self, document: Document) -> bool:
        """Read more frames whole that were not read yet; return whether any is left."""
        for frame in list(islice(self._unread, _AT_ONCE)):
            del self._unread[frame]
            if frame in document.results:
                self._read(document, frame)
        return bool(self._unread)

    def _read(self, document: Document, frame: int) -> None:
        result, truth = document.results[frame], document.truth_at(frame)
        row, values = frame - self.frames.start, result.parameters
        estimate = result.joint_positions if result.keypoints21 is None else result.keypoints21
        self._put(ERROR, row, mean_error_mm(estimate, truth))
        self._put(MOVED, row, moved_mm(result, document.results.below(frame)))
        if self.values.shape[1] != len(values):
            shape = len(self.frames), len(values)
            self.values, self.std = (np.full(shape, np.nan) for _ in range(2))
        self.values[row], self.std[row] = values, result.parameter_std
        if truth is not None and result.keypoints21 is not None:
            own, true = flexion_deg(np.stack([result.keypoints21, truth]))
            self.bent[row] = np.deg2rad(true - own)
        self.changed.add(row)

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
            for values in (*self.lanes.values(), self.values, self.std, self.bent):
                values[row] = np.nan


def cost_parts(energies: Mapping[str, float]) -> dict[str, float]:
    """Return the parts of a frame's energy by their words."""
    parts: dict[str, float] = {}
    for name, cost in energies.items():
        word = TERM_WORDS.get(name, name)
        parts[word] = parts.get(word, 0.0) + cost
    return parts


def moved_mm(result: FrameResult, before: FrameResult | None) -> float:
    """Return how far the furthest joint of a frame is from where it was [mm]; NaN where that is not known."""
    if before is None or before.joint_positions.shape != result.joint_positions.shape:
        return float("nan")
    moves = np.linalg.norm(result.joint_positions - before.joint_positions, axis=1)
    return float(1e3 * moves.max())
