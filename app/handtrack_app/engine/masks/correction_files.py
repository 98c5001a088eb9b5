"""The files of corrected masks, kept as the session's state has them; who changed one elsewhere is right."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from handtrack.errors import HandtrackError
from handtrack.session.session import Session
from handtrack.session.session_state import Correction, Edit, decide
from handtrack_app.engine.masks.mask_state import correction_of


class CorrectionFiles:
    """What was written to them here, so that other content is known, and kept."""

    def __init__(self) -> None:
        self._ours: dict[tuple[str, int], bytes | None] = {}

    def changed_elsewhere(
        self, session: Session, known: Mapping[tuple[str, int], Correction]
    ) -> list[Edit]:
        """Return edits by what files say otherwise than the state, which was written after them."""
        found = list[Edit]()
        for at, correction in known.items():
            try:
                place, content = correction_of(session, at, correction)
            except HandtrackError:
                continue  # what cannot be is told where the state is applied
            path = place.path(at[1])
            stands = path.read_bytes() if path.is_file() else None
            if stands == content:
                self._ours[at] = stands
            else:
                now = None if stands is None else Correction(stands)
                found.append(decide(correction={at: now}))
        return found

    def write(
        self, session: Session, changed: Iterable[tuple[tuple[str, int], Correction | None]]
    ) -> None:
        """Write what an action changed, before the action itself. Raises HandtrackError."""
        for at, correction in changed:
            place, content = correction_of(session, at, correction)
            if place.write(at[1], content, self._ours.get(at)):
                self._ours[at] = content
