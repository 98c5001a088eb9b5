"""FrameNotes: collects remarks about single frames and words them in few sentences."""

from __future__ import annotations

import re
import threading
from collections.abc import Sequence

_MOST_RUNS = 6


class FrameNotes:
    """Sentences by frame; those that differ by numbers alone are told once. Safe from several threads."""

    def __init__(self) -> None:
        self._texts: dict[int, tuple[str, ...]] = {}
        self._lock = threading.Lock()

    def add(self, frame: int, *texts: str) -> None:
        """Note what was odd about a frame, in place of what was noted of it before."""
        with self._lock:
            self._texts[frame] = texts

    @property
    def texts(self) -> tuple[str, ...]:
        """Each kind of oddity once: the first frame's sentence, and which frames are like it."""
        with self._lock:
            met = sorted(self._texts.items())
        kinds: dict[str, list[tuple[int, str]]] = {}
        for frame, texts in met:
            for text in texts:
                kinds.setdefault(re.sub(r"\d+", "", text), []).append((frame, text))
        return tuple(_sentence(alike) for alike in kinds.values())


def listed(frames: Sequence[int]) -> str:
    """Return frame numbers as runs, such as `3-5, 9`, at most a few of them. frames: ascending."""
    runs: list[list[int]] = []
    for frame in frames:
        if runs and frame == runs[-1][1] + 1:
            runs[-1][1] = frame
        else:
            runs.append([frame, frame])
    shown = ", ".join(str(a) if a == b else f"{a}-{b}" for a, b in runs[:_MOST_RUNS])
    return shown + (f" and {len(runs) - _MOST_RUNS} more runs" if len(runs) > _MOST_RUNS else "")


def _sentence(alike: Sequence[tuple[int, str]]) -> str:
    """Return the first text, and the frames of the others. alike: (frame, text), ascending."""
    (_, text), others = alike[0], [frame for frame, _ in alike[1:]]
    if not others:
        return text
    return f"{text} The same in {len(others)} more frames: {listed(others)}."
