"""The current track frame by frame: of takes that lie over one another, read from disk when a frame is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from handtrack.parallel import LRUCache
from handtrack.store.take import StoredFrame
from handtrack.tracking.frame.result import FrameResult, TrackLabels

_MOST_READ = 256  # frames whose arrays stay in memory, about 3 MB: those that one looks at

Head = StoredFrame | FrameResult
"""status, energy and its parts of a frame; one that is nowhere on disk is its own head"""


@dataclass(eq=False)
class TakeFrames(Mapping[int, FrameResult]):
    """The frames of one take."""

    labels: TrackLabels
    """of the model, settings and size that it was tracked with"""
    heads: dict[int, Head] = field(default_factory=dict)
    puts: list[int] = field(default_factory=list)
    """frames that were taken since it was read or begun, in this order: whoever follows it looks at these alone"""
    _read: LRUCache[int, FrameResult] = field(default_factory=LRUCache)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return self.labels.parameter_names

    def put(self, result: FrameResult, head: StoredFrame | None) -> None:
        """Take a frame, in the place of the one that was there. head: where it is on disk; None: nowhere."""
        self.heads[result.frame] = result if head is None else head
        self.puts.append(result.frame)
        self._read.put(result.frame, result, _MOST_READ)

    def __getitem__(self, frame: int) -> FrameResult:
        """Raises KeyError, or HandtrackError where a frame cannot be read any more."""
        head = self.heads[frame]
        if isinstance(head, FrameResult):
            return head
        return self._read.value(frame, head.read, lambda _: _MOST_READ)

    def __contains__(self, frame: object) -> bool:
        return frame in self.heads

    def __iter__(self) -> Iterator[int]:
        return iter(self.heads)

    def __len__(self) -> int:
        return len(self.heads)


@dataclass(eq=False)
class CurrentTrack(Mapping[int, FrameResult]):
    """Takes over one another; where an upper one lacks a frame, the one below shows."""

    layers: Sequence[tuple[range, TakeFrames]] = ()
    """frames for which a take counts, and the take; the uppermost last"""

    def head(self, frame: int) -> Head | None:
        """Return what is known of a frame without its arrays; None of one that was not tracked."""
        take = self._take(frame)
        return None if take is None else take.heads[frame]

    def below(self, frame: int) -> FrameResult | None:
        """Return what showed at a frame before the take that shows there was laid over it; None where nothing did."""
        takes = [*self._takes(frame)]
        return takes[1][frame] if len(takes) > 1 else None

    @property
    def refinement(self) -> str | None:
        """What the frames of the uppermost take share that shows anywhere and tells it: frames beside a correction tell nothing new."""
        telling = (take for _, take in reversed(self.layers) if take.labels.refinement is not None)
        return next((take.labels.refinement for take in telling if self.count_of(take)), None)

    def count_of(self, take: TakeFrames) -> int:
        """Return how many frames a take shows."""
        return sum(self._take(frame) is take for frame in take)

    def _takes(self, frame: object) -> Iterator[TakeFrames]:
        """Yield the takes that have a frame, the uppermost first."""
        return (take for frames, take in reversed(self.layers) if frame in take and frame in frames)

    def _take(self, frame: object) -> TakeFrames | None:
        return next(self._takes(frame), None)

    def __getitem__(self, frame: int) -> FrameResult:
        """Raises KeyError, or HandtrackError where a frame cannot be read any more."""
        take = self._take(frame)
        if take is None:
            raise KeyError(frame)
        return take[frame]

    def __contains__(self, frame: object) -> bool:
        return self._take(frame) is not None

    def __iter__(self) -> Iterator[int]:
        """Ascending."""
        shown = {frame for frames, take in self.layers for frame in take if frame in frames}
        return iter(sorted(shown))

    def __len__(self) -> int:
        return sum(1 for _ in self)
