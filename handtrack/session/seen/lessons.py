"""Images that a method of masks learns from, kept while its settings are tried: decoding them takes longer than learning."""

from __future__ import annotations

from handtrack.arrays import Array, Axes, H, W
from handtrack.capture.images.frames import FrameSource
from handtrack.session.seen.memory import Memory

_BYTES_KEPT = 100_000_000  # of one camera: the usual 25 images of up to 4 MB


class Lessons:
    """A source that reads each frame once; see capture.images.frames.FrameSource."""

    def __init__(self, source: FrameSource, memory: Memory[int, Array[H, W, *Axes] | None]) -> None:
        """memory: of this source alone."""
        self._source, self._memory = source, memory

    @property
    def where(self) -> str:
        return self._source.where

    @property
    def size(self) -> tuple[int, int] | None:
        return self._source.size

    @property
    def frames(self) -> range:
        return self._source.frames

    @property
    def known_frames(self) -> range:
        return self._source.known_frames

    @property
    def warnings(self) -> tuple[str, ...]:
        return self._source.warnings

    def has(self, frame: int) -> bool:
        return self._source.has(frame)

    def read(self, frame: int) -> Array[H, W, *Axes] | None:
        return self._memory.value(frame, lambda: self._source.read(frame), _most)


def _most(image: Array[H, W, *Axes] | None) -> int:
    return max(_BYTES_KEPT // (1 if image is None else image.nbytes), 1)
