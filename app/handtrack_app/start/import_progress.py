"""How far an import is: what its command prints, as steps with a bar and the time that is left; and what it has found so far."""

from __future__ import annotations

import html
import re
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import D3, Bytes, H, W
from handtrack.session.session import Session
from handtrack.session.sources.views import View
from handtrack_app.page.html import text

_BAR = re.compile(r"^\w+:\s+(\d+)%\|.*?[\d:]+<([\d:]+|\?)")
"""of tqdm: what is done, how much of it, and the time that is left"""
_STEPS = {"looking for the first pose": "Find first pose", "detecting": "Detect joints", "sizing": "Fit size", "tracking": "Track", "refining": "Refine"}  # fmt: skip
_IMPORT = "Import files"
_LINES = 8
_HIGH = 160  # [px] of a small picture
_JOINT = (0, 159, 230)  # BGR


@dataclass
class ImportProgress:
    """What a command said so far."""

    title: str
    step: str = _IMPORT
    share: float | None = None
    """of the step; None: not known"""
    left: str = ""
    """minutes and seconds until the step is done"""
    lines: list[str] = field(default_factory=list)
    _done: list[str] = field(default_factory=list)

    def hear(self, line: str) -> bool:
        """Take a line; return whether another step began."""
        bar = _BAR.match(line)
        if bar is None and not line.startswith("stopping"):
            self.lines = [*self.lines[1 - _LINES :], line]
        step = next((step for word, step in _STEPS.items() if line.startswith(word)), self.step)
        began = step != self.step
        if began:
            self._done = [*self._done, self.step]
            self.step, self.share, self.left = step, None, ""
        if bar is not None:
            self.share, self.left = int(bar[1]) / 100, bar[2].strip("?")
        return began

    def words(self) -> str:
        """Return the steps and the newest lines as HTML."""
        steps = "".join(
            f"<div>✓ {step}</div>" for step in dict.fromkeys(self._done) if step != self.step
        )
        now = "" if self.share is None else f" · {100 * self.share:.0f} %"
        now += f" · {self.left} left" if self.left else ""
        steps += f"<div><b>▸ {self.step}</b>{now}</div>"
        lines = "".join(f"<div>{html.escape(line)}</div>" for line in self.lines)
        return text(f"<b>{html.escape(self.title)}</b>{steps}", faint=False) + text(lines)


def joints_found(folder: Path) -> dict[str, Bytes[H, W, D3]]:
    """Return a small picture BGR of each camera of a session, with the joints that were detected in it. Raises HandtrackError."""
    session = Session.open(folder)
    middle = session.frame_range[session.frame_count // 2]
    drawn = {view.name: _drawn(view, middle) for view in session.views}
    return {name: picture for name, picture in drawn.items() if picture is not None}


def _drawn(view: View, frame: int) -> Bytes[H, W, D3] | None:
    image = view.image(frame)
    if image is None:
        return None
    scale = _HIGH / image.shape[0]
    size = (round(image.shape[1] * scale), _HIGH)
    small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    for found in view.keypoints(frame, 1.0):
        for x, y in scale * found.pixels[np.isfinite(found.pixels).all(axis=1)]:
            cv2.circle(small, (round(x), round(y)), 3, _JOINT, -1, cv2.LINE_AA)
    return small
