"""Edits of masks: what a wish of the mask desk's changes of the session's state. They read the document and change nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields

import numpy as np

from handtrack.arrays import D2, Floats, N
from handtrack.capture.masks.mask_correction import AS_IT_IS, BACKGROUND, HAND, empty_layer, painted
from handtrack.capture.masks.seeded import UNKNOWN_LEVEL
from handtrack.capture.masks.segmentation import METHODS, mask_method_table
from handtrack.errors import HandtrackError, unknown_name
from handtrack.session.session_state import NOTHING, Correction, Edit, MaskSource, decide
from handtrack.session.sources.corrected_masks import encoded
from handtrack.session.sources.views import MaskChoice, View
from handtrack_app.engine.document import Document
from handtrack_app.engine.masks.mask_state import source_of, usual_values
from handtrack_app.protocol.masks import FILES, NO_MASKS

BRUSHES = {"hand": HAND, "not hand": BACKGROUND, "unknown": UNKNOWN_LEVEL, "as it is": AS_IT_IS}
_MOST_POINTS, _LARGEST_PX = 4096, 500.0  # of a stroke; no page sends more
_DEPTHS_M = {"near_m": 0.2, "far_m": 0.8}  # of a hand before a camera on a desk, to begin with


def masks(document: Document, camera: str, values: Mapping[str, object]) -> Edit:
    """Change method, thresholds or box of one camera's masks, or of all that have what it takes. Raises HandtrackError."""
    views = {view.name: view for view in document.run.session.views}
    if camera and camera not in views:
        raise unknown_name("camera", camera, tuple(views))
    wanted = [views[camera]] if camera else list(views.values())
    found, why = dict[str, MaskSource](), ""
    for view in wanted:
        try:
            found[view.name] = _changed(document, view, dict(values))
        except HandtrackError as error:
            why = str(error)
    if not found:
        raise HandtrackError(why)
    return decide(masks=found)


def _changed(document: Document, view: View, values: dict[str, object]) -> MaskSource:
    source = source_of(document.masks[view.name])
    table, roi = source.masks, source.roi
    if "method" in values:
        table = _begun(document, view, str(values.pop("method")))
    if "roi" in values:
        roi, box = None, values.pop("roi")
        if isinstance(box, list | tuple):
            x, y, width, height = (int(part) for part in box)
            roi = x, y, width, height
    if values:
        known = table if isinstance(table, dict) else dict[str, object]()
        for name in values:
            if name not in known:
                raise HandtrackError(f"the masks of camera '{view.name}' have no setting '{name}'.")
        table = {**known, **values}
    return MaskSource(table, roi)


def _begun(document: Document, view: View, name: str) -> str | dict[str, object] | None:
    """Return a method as it begins: as session.toml has it, else as it is usual. Raises HandtrackError where it cannot be."""
    saved = document.saved_masks[view.name][0]
    if name == NO_MASKS:
        return None
    if name == FILES:
        if not isinstance(saved, str):
            raise HandtrackError(
                f"session.toml names no files of masks for camera '{view.name}': `masks = \"masks/{view.name}/*.png\"` does."
            )
        return saved
    if name not in possible_methods(document, view):
        needs = METHODS[name].needs if name in METHODS else "a method that is known"
        raise HandtrackError(
            f"masks of camera '{view.name}' cannot be made by '{name}': it needs {needs}, and joints for 'seeded'."
        )
    if saved is not None and not isinstance(saved, str) and saved.name == name:
        return mask_method_table(saved)
    kind = METHODS[name]
    width, height = view.camera.size
    middle = [3 * width // 7, 3 * height // 7, width // 7, height // 7]
    needed = {"sample": middle, "reference": document.frame, **_DEPTHS_M}
    given = {item.name: needed[item.name] for item in fields(kind) if item.name in needed}
    return {"method": name, **usual_values(kind), **given}


def possible_methods(document: Document, view: View) -> tuple[str, ...]:
    """Return the methods that a camera has what it takes for; files where session.toml names some."""
    settings, saved = view.settings, document.saved_masks[view.name][0]
    found = [name for name, kind in METHODS.items() if getattr(settings, kind.needs) is not None]
    if settings.keypoints is None:
        found = [name for name in found if name != "seeded"]
    return (*found, *([FILES] if isinstance(saved, str) else []), NO_MASKS)


def marked_box(
    document: Document, camera: str, what: str, box: tuple[int, int, int, int], frame: int
) -> Edit:
    """Take a box dragged over a camera's undistorted image as its region of interest, or as the sample of skin."""
    view = document.run.session.view(camera)
    x, y, width, height = box
    edges = [(x + s * width, y + t * height) for s in (0, 0.5, 1) for t in (0, 0.5, 1)]
    places = _as_taken(view, edges)
    size = np.array(view.camera.size)
    low = np.clip(np.round(places.min(axis=0)), 0, size - 2).astype(int)
    high = np.clip(np.round(places.max(axis=0)), low + 2, size).astype(int)
    values: dict[str, object] = {what: tuple(int(v) for v in (*low, *(high - low)))}
    if what == "sample":
        values["reference"] = document.clamped(frame)
    return masks(document, camera, values)


def painting(
    document: Document,
    frame: int,
    camera: str,
    brush: str,
    points: Sequence[tuple[float, float]],
    radius_px: float,
) -> Edit:
    """Paint a stroke over a camera's mask. Raises HandtrackError where there is nothing to paint on."""
    view, own = _place(document, camera, frame)
    stroke = np.asarray(points[:_MOST_POINTS], dtype=float).reshape(-1, 2)
    stroke = stroke[np.isfinite(stroke).all(axis=1)]
    if not len(stroke) or brush not in BRUSHES or not np.isfinite(radius_px):
        return NOTHING
    layer = view.corrections.layer(own)
    layer = empty_layer(view.camera.size) if layer is None else layer
    radius = min(max(float(radius_px), 0.5), _LARGEST_PX)
    after = painted(layer, _as_taken(view, stroke.tolist()), radius, BRUSHES[brush])
    content = encoded(after)
    now = None if content is None else Correction(content)
    return decide(correction={(view.name, own): now})


def dropped(document: Document, camera: str, frame: int) -> Edit:
    """Drop the correction of a camera's frame."""
    view, own = _place(document, camera, frame)
    return decide(correction={(view.name, own): None})


def is_painted(document: Document, camera: str, own_frame: int) -> bool:
    """Return whether a frame was corrected there, and not only carried to it."""
    correction = document.in_force(("correction", (camera, own_frame)))
    return correction is not None and not correction.carried


def _place(document: Document, camera: str, frame: int) -> tuple[View, int]:
    view = document.run.session.view(camera)
    own = view.own_frame(document.clamped(frame))
    if own is None:
        raise HandtrackError(f"camera '{camera}' shows nothing at frame {frame}.")
    return view, own


def _as_taken(view: View, points: Sequence[Sequence[float]]) -> Floats[N, D2]:
    """Return where points of the undistorted image (N, 2) lie in the image as it was taken [px]."""
    places = np.asarray(points, dtype=float)
    if view.camera.is_distorted:
        places = view.camera.distort_points(places)
    return np.nan_to_num(places, nan=-1e4)


def method_of(choice: MaskChoice) -> str:
    """Return the page's name of where masks come from."""
    masks = choice[0]
    return NO_MASKS if masks is None else FILES if isinstance(masks, str) else masks.name
