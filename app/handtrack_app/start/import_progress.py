"""How far an import is: what its command prints, as steps with a bar and the time that is left; and what it has found so far."""

from __future__ import annotations

import html
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from handtrack.arrays import D2, D3, Bytes, Floats, H, N, W
from handtrack.session.session import Session
from handtrack_app.page.html import text

_BAR = re.compile(r"^\w+:\s+(\d+)%\|.*?[\d:]+<([\d:]+|\?)")
"""of tqdm: what is done, how much of it, and the time that is left"""
_STEPS = {"looking for the first pose": "Find first pose", "detecting": "Detect joints", "sizing": "Fit size", "tracking": "Track", "refining": "Refine"}  # fmt: skip
_IMPORT = "Import files"
_LINES = 8
_HIGH = 240  # [px] of a small picture
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


def detected_joints(folder: Path) -> dict[str, Bytes[H, W, D3]]:
    """Return a small picture BGR of each camera of a session, with the joints that were detected in it. Raises HandtrackError."""
    session = Session.open(folder)
    middle = session.frame_range[session.frame_count // 2]
    return {
        view.name: small_picture(image, [joints.pixels for joints in view.keypoints(middle, 1.0)])
        for view in session.views
        if (image := view.image(middle)) is not None
    }


def small_picture(image: Bytes[H, W, D3], joints: Iterable[Floats[N, D2]] = ()) -> Bytes[H, W, D3]:
    """Return an image small, with joints [px] as points."""
    scale = _HIGH / image.shape[0]
    size = (round(image.shape[1] * scale), _HIGH)
    small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    for x, y in (scale * row for hand in joints for row in hand[np.isfinite(hand).all(axis=1)]):
        cv2.circle(small, (round(x), round(y)), 2, _JOINT, -1, cv2.LINE_AA)
    return small


# ---- A command of handtrack as a program of its own, read line by line: what it says is shown as it comes


_ITSELF = "import sys; from handtrack_app.cli import main; sys.exit(main(sys.argv[1:]))"


class Program:
    """A running command."""

    def __init__(
        self,
        args: Sequence[str],
        report: Callable[[str], None],
        end: Callable[[int], None],
    ) -> None:
        """Start it. tell: is called with each line, end: with the exit code, both on a thread of its own."""
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _ITSELF, *args],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            encoding="utf-8", errors="replace", env=environment, process_group=0 if os.name == "posix" else None,
        )  # fmt: skip
        threading.Thread(target=self._read, args=(report, end), daemon=True).start()

    def cancel(self) -> None:
        """Interrupt it, as Ctrl-C does: it ends cleanly."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)

    def _read(self, report: Callable[[str], None], end: Callable[[int], None]) -> None:
        assert self._process.stdout is not None
        with self._process:
            for line in self._process.stdout:
                if line.strip():
                    report(line.strip())
        end(self._process.returncode)
