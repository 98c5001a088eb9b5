"""What the session's state says of masks: each camera's method and box, and the corrections of its frames. Changes nothing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields

from handtrack.capture.masks.segmentation import MaskMethod, mask_method_table, read_mask_method
from handtrack.errors import HandtrackError
from handtrack.session.session import Session
from handtrack.session.session_state import Correction, Edit, MaskSource, decide
from handtrack.session.sources.corrected_masks import CorrectedMasks, decoded
from handtrack.session.sources.views import MaskChoice, View


def choice_of(view: View) -> MaskChoice:
    """Return where a camera's masks come from, and its region of interest."""
    return view.settings.masks, view.settings.roi


def source_of(choice: MaskChoice) -> MaskSource:
    """Return a choice as the state has it."""
    masks, roi = choice
    return MaskSource(masks if isinstance(masks, str | None) else mask_method_table(masks), roi)


def choice_from(source: MaskSource, camera: str) -> MaskChoice:
    """Return the choice that the state has. Raises HandtrackError."""
    masks = source.masks
    if isinstance(masks, dict):
        return read_mask_method(masks, f"masks of camera '{camera}'"), source.roi
    return masks, source.roi


def usual_values(kind: type[MaskMethod]) -> dict[str, object]:
    """Return what a method's settings are unless said."""
    return {item.name: item.default for item in fields(kind) if item.default is not MISSING}


def correction_of(
    session: Session, at: tuple[str, int], correction: Correction | None
) -> tuple[CorrectedMasks, bytes | None]:
    """Return the corrected masks of a camera, and what they hold of its own frame; None: nothing. Raises HandtrackError."""
    camera, own_frame = at
    view = session.view(camera)
    if correction is None:
        return view.corrections, None
    decoded(correction.png, view.camera.size, f"the correction {camera}/{own_frame}")
    return view.corrections, correction.png


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
