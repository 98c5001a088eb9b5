"""Which frames were shown a moment ago: what is made of one comes later than its hand, and may stand for so long beside the next."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

_MOMENT_S = 0.3
"""the engine paints every 0.08 s, while it tracks every 0.25 s; what is older would deceive"""


@dataclass
class Moments:
    """The frame shown, and when others gave way to the next."""

    frame: int | None = None
    _left: dict[int, float] = field(default_factory=dict)
    """by frame [s]"""

    def show(self, frame: int) -> None:
        """Another frame is shown, or the same again."""
        now = time.monotonic()
        if self.frame is not None and self.frame != frame:
            self._left[self.frame] = now
        self._left = {f: when for f, when in self._left.items() if now - when < _MOMENT_S}
        self.frame = frame

    def fits(self, frame: int | None) -> bool:
        """Return whether what was made of a frame may be seen now: of the one shown, or, in motion, of one just before."""
        if frame is None or frame == self.frame:
            return frame is not None
        return time.monotonic() - self._left.get(frame, -_MOMENT_S) < _MOMENT_S
