"""One thing that the doctor found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

SEVERITIES = ("ok", "note", "warning", "error")


class Finding(NamedTuple):
    """What was found, in one plain sentence or two."""

    severity: str
    """ok: as it should be; note: worth knowing; warning: probably wrong; error: tracking cannot
    use it."""
    text: str


def listed(frames: Sequence[int], most: int = 6) -> str:
    """Return frame numbers as runs, such as `3-5, 9`, at most a few of them. frames: ascending."""
    runs: list[list[int]] = []
    for frame in frames:
        if runs and frame == runs[-1][1] + 1:
            runs[-1][1] = frame
        else:
            runs.append([frame, frame])
    shown = ", ".join(str(a) if a == b else f"{a}-{b}" for a, b in runs[:most])
    return shown + (f" and {len(runs) - most} more runs" if len(runs) > most else "")
