"""What a frame's pose was before the last step that changed it: read from the history, so it is known after a restart, too."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from handtrack.arrays import Floats, S
from handtrack.store.history import History, Value, merged
from handtrack.store.store import SPANS, spans_of
from handtrack_app.engine.document import Document
from handtrack_app.engine.store import keys

_SAME = 1e-9
"""[m, rad] a pose that was written and read again differs by less"""


def pose_before(document: Document, history: History) -> Floats[S] | None:
    """Return the joint parameters of the frame shown before the last step of the history that changed them; None where no step
    did, or nobody knew a pose before.
    """
    key = keys.pose(document.frame)
    said: dict[str, Value] = {name: history.state.get(name) for name in (key, SPANS)}
    now = document.shown
    for step in history.past.latest_first():
        earlier = said | {c.key: c.before for c in merged(step) if c.key in said}
        if earlier != said:
            was = _pose(document, key, earlier)
            if was is not None and np.abs(was - now).max() > _SAME:
                return was
        said = earlier
    return None


def _pose(document: Document, key: str, said: Mapping[str, Value]) -> Floats[S] | None:
    """Return the pose that showed at the frame with these values of the state."""
    frame, given = document.frame, said[key]
    if given is not None:
        return document.posed(given)
    for span in reversed(spans_of(said[SPANS])):
        take = document.takes.get(span.take) if span.first <= frame < span.stop else None
        if take is not None and take.parameter_names == document.model.parameter_names:
            result = take.get(frame)  # where it lacks the frame, the one below shows
            if result is not None:
                return result.parameters
    return document.start if frame == document.first_frame else None
