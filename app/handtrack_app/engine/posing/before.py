"""What a frame's pose was before the last step that changed it: read from the history, so it is known after a restart, too."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import Floats, S
from handtrack.session.session_state import SessionState, name_of, read
from handtrack.store.history import History, merged
from handtrack_app.engine.document import Document

_SAME = 1e-9
"""[m, rad] a pose that was written and read again differs by less"""


def pose_before(document: Document, history: History) -> Floats[S] | None:
    """Return the joint parameters of the frame shown before the last step of the history that changed them; None where no step
    did, or nobody knew a pose before.
    """
    state, here = document.state, ("pose", document.frame)
    names, now = {name_of(here), name_of(("spans", None))}, document.shown
    for step in history.past.latest_first():
        earlier = read({c.key: c.before for c in merged(step) if c.key in names})
        if not earlier:
            continue
        state = state.having(earlier)
        was = _pose(document, state)
        if was is not None and np.abs(was - now).max() > _SAME:
            return was
    return None


def _pose(document: Document, state: SessionState) -> Floats[S] | None:
    """Return the pose that showed at the frame when this was decided."""
    frame, decided = document.frame, state.pose.get(document.frame)
    if decided is not None:
        return document.posed(decided)
    for span in reversed(state.spans):
        take = document.takes.get(span.take) if span.first <= frame < span.stop else None
        if take is not None and take.parameter_names == document.model.parameter_names:
            result = take.get(frame)  # where it lacks the frame, the one below shows
            if result is not None:
                return result.parameters
    return document.start if frame == document.first_frame else None
