"""The part of the recording that the lanes show: where frames stand in it, zooming and paging."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Array, Floats, Ints, N

WIDTH = 1000  # of the lanes, in their own units
_COLUMNS = 400  # of neighbouring frames: what is sent does not grow with the recording
_LEAST = 10  # frames
_TICKS = 8  # at most, so that their numbers stand apart


@dataclass(frozen=True)
class Window:
    """Frames first to last: they stand at 0 and at WIDTH, as on the slider that lies over them."""

    first: int
    last: int

    @property
    def count(self) -> int:
        return self.last - self.first + 1

    def place(self, frame: float) -> float:
        """Return where a frame stands."""
        return (frame - self.first) / max(self.last - self.first, 1) * WIDTH

    def columns(self, most: int = _COLUMNS) -> Ints[N]:
        """Return where columns of neighbouring frames begin, the end with them: at most so many that each can be seen."""
        columns = min(self.count, most)
        return self.first + np.arange(columns + 1) * self.count // columns

    def ticks(self) -> list[int]:
        """Return round frame numbers to be named."""
        rough = max(self.count / _TICKS, 1.0)
        power = 10.0 ** np.floor(np.log10(rough))
        step = int(power * next(n for n in (1, 2, 5, 10) if n * power >= rough * 0.999))
        return list(range(-(-self.first // step) * step, self.last + 1, step))

    def zoomed(self, factor: float, around: int, frames: range) -> Window:
        """Return a window of `factor` times as many frames, in which a frame stays where it stands."""
        count = int(np.clip(round(self.count * factor), min(_LEAST, len(frames)), len(frames)))
        share = (min(max(around, self.first), self.last) - self.first) / max(self.count - 1, 1)
        return Window(0, count - 1).moved_to(round(around - share * (count - 1)), frames)

    def moved_to(self, first: int, frames: range) -> Window:
        """Return a window as long as this that begins at a frame, or where the recording lets it."""
        first = max(min(first, frames.stop - self.count), frames.start)
        return Window(first, min(first + self.count, frames.stop) - 1)

    def around(self, frame: int, frames: range) -> Window:
        """Return a window with a frame in it: this, or the page that begins a tenth before it."""
        if self.first <= frame <= self.last:
            return self
        return self.moved_to(frame - self.count // 10, frames)

    @property
    def half(self) -> float:
        """Half a frame's width."""
        return 0.5 * WIDTH / max(self.last - self.first, 1)


def whole(frames: range) -> Window:
    """Return the window of all frames."""
    return Window(frames.start, max(frames.stop - 1, frames.start + 1))


def extremes(
    values: Floats[N], start: int, window: Window, most: int = _COLUMNS
) -> tuple[Floats[N], Floats[N], Floats[N]]:
    """Return of each column its place, and the least and largest known value in it, NaN where none is known. start: of values; most: columns."""
    edges = window.columns(most)
    padded = np.full(window.count, np.nan)
    first, stop = max(window.first, start), min(window.last + 1, start + len(values))
    if first < stop:
        padded[first - window.first : stop - window.first] = values[first - start : stop - start]
    known, at = np.isfinite(padded), edges[:-1] - window.first
    low = np.minimum.reduceat(np.where(known, padded, np.inf), at)
    high = np.maximum.reduceat(np.where(known, padded, -np.inf), at)
    place = np.array([window.place(x) for x in (edges[:-1] + edges[1:] - 1) / 2])
    none = ~np.isfinite(high)
    return place, np.where(none, np.nan, low), np.where(none, np.nan, high)


def runs(marked: Array[N]) -> list[tuple[int, int]]:
    """Return where true values follow one another, half-open."""
    edges = np.flatnonzero(np.diff(np.r_[0, np.asarray(marked, int), 0]))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
