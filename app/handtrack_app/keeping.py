"""What outlives the page: the journal, the first-frame pose, saved tracks, exports."""

from __future__ import annotations

import logging
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.errors import HandtrackError
from handtrack_app.document import Document

log = logging.getLogger(__name__)
LOG_FILE = Path(tempfile.gettempdir()) / "handtrack.log"


@dataclass(frozen=True)
class Restored:
    """What was found from the last time."""

    frame: int | None = None
    text: str = ""


def restore(document: Document) -> Restored:
    return Restored()


def note(document: Document, entry: dict[str, Any]) -> None:
    pass


def note_results(document: Document, frames: range) -> None:
    pass


def save_first_pose(document: Document) -> str:
    return ""


def save_track(document: Document) -> str:
    return ""


def export(document: Document, kind: str) -> tuple[str, bytes]:
    raise HandtrackError("not yet")


def summary(document: Document, frames: range, done: int, seconds: float) -> str:
    """Return how a run of tracking went, in one sentence or two."""
    counts = np.bincount([int(document.results[f].status) for f in frames if f in document.results], minlength=5)
    speed = f"{1000 * seconds / max(done, 1):.0f} ms a frame"
    odd = [f"{counts[i]} {word}" for i, word in ((1, "doubtful"), (2, "lost")) if counts[i]]
    quality = ", ".join(odd) if odd else "none doubtful"
    return f"{done} of {len(frames)} frames in {seconds:.1f} s ({speed}); {quality}."


def internal_error_text(error: object) -> str:
    """Return what the user is told of a mistake of ours."""
    what = error if isinstance(error, str) else f"{type(error).__name__}: {error}"
    return f"Something went wrong inside handtrack ({what}). Your poses are safe. Details are in {LOG_FILE}."
