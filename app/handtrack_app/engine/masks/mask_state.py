"""What the session's state says of masks: each camera's method and box, and the corrections of its frames. Changes nothing."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields

from handtrack.capture.masks.segmentation import MaskMethod, mask_method_table, read_mask_method
from handtrack.errors import HandtrackError
from handtrack.session.session import Session
from handtrack.session.sources.corrected_masks import CorrectedMasks, decoded
from handtrack.session.sources.views import MaskChoice, View
from handtrack.store.history import Value
from handtrack_app.engine.store import keys


def choice_of(view: View) -> MaskChoice:
    """Return where a camera's masks come from, and its region of interest."""
    return view.settings.masks, view.settings.roi


def choice_value(choice: MaskChoice) -> Value:
    """Return a choice as the state has it."""
    masks, roi = choice
    table = masks if isinstance(masks, str | None) else mask_method_table(masks)
    return {"masks": table, "roi": None if roi is None else list(roi)}


def choice_from(value: Value, camera: str) -> MaskChoice:
    """Return the choice that a value of the state is. Raises HandtrackError."""
    masks, roi = value["masks"], value["roi"]
    if masks is not None and not isinstance(masks, str):
        masks = read_mask_method(masks, f"masks of camera '{camera}'")
    if roi is None:
        return masks, None
    x, y, width, height = (int(part) for part in roi)
    return masks, (x, y, width, height)


def usual_values(kind: type[MaskMethod]) -> dict[str, object]:
    """Return what a method's settings are unless said."""
    return {item.name: item.default for item in fields(kind) if item.default is not MISSING}


@dataclass(frozen=True)
class Correction:
    """A correction of one frame of a camera, as the state has it."""

    place: CorrectedMasks
    own_frame: int
    content: bytes | None
    """as a PNG file; None: not corrected"""


def correction_of(session: Session, name: str, value: Value) -> Correction:
    """Return the correction that a value of the state is. name: camera and its own frame. Raises HandtrackError or ValueError."""
    camera, _, frame = name.rpartition("/")
    view = session.view(camera)
    if value is None:
        return Correction(view.corrections, int(frame), None)
    try:
        content = base64.b64decode(value["png"], validate=True)
    except binascii.Error:
        raise HandtrackError(f"the correction {name} is damaged.") from None
    decoded(content, view.camera.size, f"the correction {name}")
    return Correction(view.corrections, int(frame), content)


def correction_value(content: bytes | None, is_carried: bool = False) -> Value:
    """Return a correction as the state has it. is_carried: from a frame beside, not painted there."""
    if content is None:
        return None
    return {"png": base64.b64encode(content).decode("ascii"), "carried": is_carried}


def corrections_in(session: Session, values: Mapping[str, Value]) -> list[Correction]:
    """Return all corrections among values of the state. Raises HandtrackError or ValueError."""
    return [
        correction_of(session, name, value)
        for key, value in values.items()
        for kind, name in (keys.parts(key),)
        if kind == keys.CORRECTION
    ]


def corrected_value(session: Session, name: str, known: Value) -> Value:
    """Return the correction in force, also of a file that the state does not know. known: what the state says."""
    if known is not None:
        return known
    camera, _, frame = name.rpartition("/")
    return correction_value(session.view(camera).corrections.content(int(frame)))
