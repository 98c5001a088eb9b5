"""MotionClip: joint positions over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, F, Floats, J
from handtrack.errors import index_of

LARGEST = 1 << 29  # bytes of a motion file: an hour


@dataclass(frozen=True)
class MotionClip:
    """What a motion capture file says of where joints are."""

    names: tuple[str, ...]
    """(J,) of the file's joints; a second end of the same joint is `<name>_end`"""
    positions: Floats[F, J, D3]
    """[m], the file's own axes"""
    fps: float
    """frames a second"""
    turns: Floats[F, J, D3, D3] | None = None
    """how each joint is turned in the file's axes, from its zero pose; None where the file does not say it"""

    def renamed(self, names: Mapping[str, str]) -> MotionClip:
        """Return only the joints that `names` lists (new name → the file's), under their new names."""
        columns = [index_of("joint", n, self.names, "the motion file") for n in names.values()]
        return MotionClip(tuple(names), self.positions[:, columns], self.fps)

    def resampled(self, fps: float) -> MotionClip:
        """Return the clip at another frame rate, places interpolated linearly."""
        count = int((len(self.positions) - 1) / self.fps * fps)
        at = np.arange(count) * self.fps / fps
        before = at.astype(int)
        share = (at - before)[:, None, None]
        places = (1 - share) * self.positions[before] + share * self.positions[before + 1]
        return MotionClip(self.names, places, fps)
