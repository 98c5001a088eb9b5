"""Files for the browser to keep, and sentences about how tracking went."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.session.formats.tables import EXPORTS
from handtrack.tracking.fallback import is_simplified
from handtrack.tracking.frame.result import FrameResult
from handtrack_app.engine.document import Document
from handtrack_app.engine.store.saved_frames import whole_track

LOG_FILE = Path(tempfile.gettempdir()) / "handtrack_workbench.log"


def export(document: Document, kind: str) -> tuple[str, bytes]:
    """Return name and content of a file: a kind of `handtrack export --to`, or `init`. Raises HandtrackError."""
    stem = (
        "".join(c if c.isalnum() else "_" for c in document.run.session.name).strip("_")
        or "session"
    )
    if kind == "init":
        values = dict(zip(document.model.parameter_names, document.shown.tolist(), strict=True))
        text = json.dumps({"frame": document.frame, "parameters": values}, indent=1) + "\n"
        return f"{stem}_frame{document.frame}_init.json", text.encode()
    if kind not in EXPORTS:
        raise HandtrackError(f"no export '{kind}'; known: {', '.join(EXPORTS)}, init")
    write, ending = EXPORTS[kind]
    track = whole_track(document)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{stem}{ending}"
        write(path, track)
        return path.name, path.read_bytes()


def summary(results: Sequence[FrameResult], total: int, by_hand: int, seconds: float) -> str:
    """Return how a run of tracking went, in one sentence or two.

    total: frames that were to be tracked. by_hand: frames that stayed as they were given.
    """
    counts = np.bincount([int(result.status) for result in results], minlength=5)
    done = len(results)
    speed = f"{1000 * seconds / max(done, 1):.0f} ms a frame"
    odd = [f"{counts[i]} {word}" for i, word in ((1, "doubtful"), (2, "lost")) if counts[i]]
    poor = sum(result.poor_cloud for result in results)
    if poor:
        odd.append(f"{poor} in a poor cloud")
    held = sum(is_simplified(result) for result in results)
    if held:
        odd.append(f"{held} with the fingers held, where the cloud is too poor for them")
    quality = ", ".join(odd) if odd else "none doubtful"
    hand = f" {by_hand} set by hand or found stayed as they are." if by_hand > 1 else ""
    if by_hand == 1:
        hand = " One, set by hand or found, stayed as it is."
    return f"{done} of {total} frames in {seconds:.1f} s ({speed}); {quality}.{hand}"


def internal_error_text(error: object) -> str:
    """Return what the user is told of a mistake of ours."""
    what = error if isinstance(error, str) else f"{type(error).__name__}: {error}"
    return f"Something went wrong inside handtrack ({what}). Your poses are safe. Details are in {LOG_FILE}."
