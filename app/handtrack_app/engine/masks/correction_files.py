"""The files of corrected masks, kept as the session's state has them; who changed one elsewhere is right."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from handtrack.errors import HandtrackError
from handtrack.session.session import Session
from handtrack.store.history import Change, Value
from handtrack_app.engine.masks.mask_state import correction_of, correction_value
from handtrack_app.engine.store import keys


class CorrectionFiles:
    """What was written to them here, so that other content is known, and kept."""

    def __init__(self) -> None:
        self._ours: dict[str, bytes | None] = {}

    def changed_elsewhere(self, session: Session, state: Mapping[str, Value]) -> dict[str, Value]:
        """Return values for what files say otherwise than the state, which was written after them."""
        found: dict[str, Value] = {}
        for key, value in state.items():
            kind, name = keys.parts(key)
            if kind != keys.CORRECTION:
                continue
            try:
                correction = correction_of(session, name, value)
            except (HandtrackError, ValueError, KeyError, TypeError):
                continue  # what cannot be is told where the state is applied
            path = correction.place.path(correction.own_frame)
            stands = path.read_bytes() if path.is_file() else None
            if stands == correction.content:
                self._ours[key] = stands
            else:
                found[key] = correction_value(stands)
        return found

    def write(self, session: Session, changes: Iterable[Change]) -> None:
        """Write what an action changed, before the action itself. Raises HandtrackError."""
        for change in changes:
            kind, name = keys.parts(change.key)
            if kind == keys.CORRECTION:
                correction = correction_of(session, name, change.after)
                place, own, content = correction.place, correction.own_frame, correction.content
                if place.write(own, content, self._ours.get(change.key)):
                    self._ours[change.key] = content
