"""A session's store as the workbench opens it, on a fake run; and what is done in it."""

from pathlib import Path
from typing import Any

from handtrack.session.session_state import Edit
from handtrack_app.engine import opening
from handtrack_app.engine.persistence import Persistence
from handtrack_app.engine.posing_service import pose as pose_edit
from tests.app.fake_run import fake_document


def opened(folder: Path, **options: Any) -> Persistence:
    """Return the store of a session that is just opened."""
    store = Persistence.open(fake_document(folder, step_s=0.0, **options))
    store.restore()
    return store


def opened_recording(folder: Path) -> Persistence:
    """Return the store of a recording in files."""
    store = Persistence.open(opening.document(opening.opened(folder)))
    store.restore()
    return store


def posed(store: Persistence, frame: int, by: float = 0.0) -> None:
    """Set a frame's pose: the first one, every parameter moved by so much."""
    values = (store.document.start + by).tolist()
    store.do(f"Pose of frame {frame}", pose_edit(store.document, frame, values))


def did(store: Persistence, edit: Edit) -> None:
    """Do something to the session's state."""
    store.do("Something", edit)


def tracked(store: Persistence, frames: range | None = None, first: int = 3) -> Persistence:
    """Track frames as a job does."""
    document = store.document
    frames = document.frames if frames is None else frames
    params = document.start_params(first)
    store.begin_take(frames, first, params)
    for result in document.run.track(frames, first, params):  # type: ignore[attr-defined]
        store.add(result)
    store.end_take(finished=True)
    return store
