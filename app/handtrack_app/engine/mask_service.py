"""The mask service: what the page sees of masks, where they come from, and what is painted over them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from handtrack.arrays import D2, Floats, N
from handtrack.capture.masks.mask_correction import (
    AS_IT_IS,
    BACKGROUND,
    HAND,
    UNKNOWN_LEVEL,
    carried,
    empty_layer,
    painted,
)
from handtrack.capture.masks.segmentation import METHODS, read_mask_method
from handtrack.errors import HandtrackError
from handtrack.session.session_state import Correction, Edit, MaskSource, decide
from handtrack.session.sources.corrections import encoded
from handtrack.session.sources.views import View
from handtrack_app.engine import edits
from handtrack_app.engine.document import mask_source, usual_values
from handtrack_app.engine.document_snapshots import possible_masks
from handtrack_app.engine.service import BackgroundJob, Service
from handtrack_app.protocol import (
    FILES,
    NO_MASKS,
    Box,
    Command,
    Notice,
)


def carry(
    job: BackgroundJob,
    views: Sequence[View],
    frame: int,
    reach: range,
    is_painted: Callable[[str, int], bool],
) -> dict[tuple[str, int], Correction]:
    """Follow what was painted by optical flow, frame by frame, up to frames that were painted themselves; return the corrections.

    reach: as far as it is carried, `frame` among them. is_painted: whether a camera's own frame was corrected by hand.
    """
    carried: dict[tuple[str, int], Correction] = {}
    directions = (range(frame + 1, reach.stop), range(frame - 1, reach.start - 1, -1))
    total = max(len(views) * sum(map(len, directions)), 1)
    for view in views:
        for frames in directions:
            for at, correction in _carried(view, frame, frames, is_painted):
                carried[at] = correction
                share = min(len(carried) / total, 0.99)
                job.progress(share, f"carrying the correction of {view.name}", "")
                if job.should_stop():
                    return {}
    if not carried:
        raise HandtrackError(
            "There is nothing to propagate: no camera that is corrected in this frame has uncorrected images in the frames beside it."
        )
    return carried


def _carried(
    view: View, frame: int, frames: range, is_painted: Callable[[str, int], bool]
) -> Iterator[tuple[tuple[str, int], Correction]]:
    own = view.own_frame(frame)
    layer = None if own is None else view.corrections.layer(own)
    before = view.image(frame)
    for at in frames:
        own, image = view.own_frame(at), view.image(at)
        if layer is None or before is None or image is None or own is None:
            return
        if is_painted(view.name, own):
            return
        layer, before = carried(layer, before, image), image
        content = encoded(layer)
        if content is None:
            return
        yield (view.name, own), Correction(content, carried=True)


BRUSHES = {"hand": HAND, "not hand": BACKGROUND, "unknown": UNKNOWN_LEVEL, "as it is": AS_IT_IS}
_DEPTHS_M = {"near_m": 0.2, "far_m": 0.8}  # of a hand before a camera on a desk, to begin with


def _as_taken(view: View, points: Sequence[Sequence[float]]) -> Floats[N, D2]:
    """Return where points of the undistorted image (N, 2) lie in the image as it was taken [px]."""
    places = np.asarray(points, dtype=float)
    if view.camera.is_distorted:
        places = view.camera.distort_points(places)
    return np.nan_to_num(places, nan=-1e4)


class MaskService(Service):
    """Masks."""

    @Command(edits=True, latest=("camera", "values"), tunes=True)
    def set_masks(self, camera: str, values: dict[str, object]) -> None:
        """Change where the masks of a camera come from (`method`), settings of the method, or the region of interest (`roi`). camera:
        empty for all that have what it takes.
        """
        names, slid = ", ".join(values), edits.is_slid(*values.values())
        edit = self._changed(camera, values)
        self.store.do(f"Masks: {names}", edit, f"{camera} {names}", is_stroke=slid)

    def _changed(self, camera: str, values: Mapping[str, object]) -> Edit:
        """Return the edit of one camera's masks, or of all that have what it takes. Raises HandtrackError."""
        session = self.document.session
        sources, why = dict[str, MaskSource](), ""
        for view in [session.view(camera)] if camera else session.views:
            try:
                sources[view.name] = self._source(view, dict(values))
            except HandtrackError as error:
                why = str(error)
        if not sources:
            raise HandtrackError(why)
        return decide(masks=sources)

    def _source(self, view: View, values: dict[str, object]) -> MaskSource:
        """Return where a camera's masks come from with other values. Raises HandtrackError."""
        source = mask_source(view)
        table = source.masks
        if "method" in values:
            table = self._begun(view, str(values.pop("method")))
        roi: Any = values.pop("roi", source.roi)
        if values:
            table = (table if isinstance(table, dict) else {}) | values
            read_mask_method(table, f"masks of camera '{view.name}'")
        return MaskSource(table, roi)

    def _begun(self, view: View, name: str) -> str | dict[str, object] | None:
        """Return a method as it begins: as session.toml has it, else as it is usual. Raises HandtrackError where it cannot be."""
        saved = self.document.saved["masks"][view.name].masks
        if name == NO_MASKS:
            return None
        if name == FILES:
            if not isinstance(saved, str):
                raise HandtrackError(
                    f"session.toml names no files of masks for camera '{view.name}': `masks = \"masks/{view.name}/*.png\"` does."
                )
            return saved
        if name not in possible_masks(self.document, view):
            needs = METHODS[name].needs if name in METHODS else "a method that is known"
            raise HandtrackError(
                f"masks of camera '{view.name}' cannot be made by '{name}': it needs {needs}, and joints for 'seeded'."
            )
        if isinstance(saved, dict) and saved["method"] == name:
            return saved
        kind = METHODS[name]
        width, height = view.camera.size
        middle = [3 * width // 7, 3 * height // 7, width // 7, height // 7]
        needed = {"sample": middle, "reference": self.document.frame, **_DEPTHS_M}
        given = {item.name: needed[item.name] for item in fields(kind) if item.name in needed}
        return {"method": name, **usual_values(kind), **given}

    @Command(edits=True, tunes=True)
    def mark_mask_box(self, camera: str, what: str, box: Box, frame: int) -> None:
        """Take a box x, y, w, h [px] of a camera's undistorted image as region of interest (`roi`) or as skin (`sample`)."""
        view = self.document.session.view(camera)
        x, y, width, height = box
        edges = [(x + s * width, y + t * height) for s in (0, 0.5, 1) for t in (0, 0.5, 1)]
        places = _as_taken(view, edges)
        size = np.array(view.camera.size)
        low = np.clip(np.round(places.min(axis=0)), 0, size - 2).astype(int)
        high = np.clip(np.round(places.max(axis=0)), low + 2, size).astype(int)
        values: dict[str, object] = {what: tuple(int(v) for v in (*low, *(high - low)))}
        if what == "sample":
            values["reference"] = frame
        self.store.do("Masks: box", self._changed(camera, values))

    @Command(edits=True, files=True)
    def paint_mask(
        self,
        frame: int,
        camera: str,
        brush: str,
        points: tuple[tuple[float, float], ...],
        radius_px: float,
        tag: str = "",
    ) -> None:
        """Paint a stroke over a camera's mask in a frame.

        brush: `hand`, `not hand`, `unknown`, or `as it is` (not corrected). points: columns and rows [px] of the undistorted image.
        tag: of the drag; what follows soon with the same is one step of undo.
        """
        words = f"Mask of {camera}, frame {frame}"
        with self.opened.changing(is_stroke=True):
            self.store.check()  # what is painted becomes a file
            view, own = self._place(camera, frame)
            layer = view.corrections.layer(own)
            layer = empty_layer(view.camera.size) if layer is None else layer
            after = painted(layer, _as_taken(view, points), radius_px, BRUSHES[brush])
            content = encoded(after)
            now = None if content is None else Correction(content)
            edit = decide(correction={(view.name, own): now})
            self.store.do(words, edit, f"{words} {tag}", waits=True, is_stroke=True)

    @Command(edits=True, files=True, tunes=True)
    def drop_correction(self, frame: int, camera: str) -> None:
        """Forget what was painted over a camera's mask in a frame."""
        self.store.check()
        _, own = self._place(camera, frame)
        edit = decide(correction={(camera, own): None})
        self.store.do(f"Correction of {camera} dropped, frame {frame}", edit)

    def _place(self, camera: str, frame: int) -> tuple[View, int]:
        """Return a camera's view and its own frame. Raises HandtrackError where it shows nothing."""
        view = self.document.session.view(camera)
        own = view.own_frame(frame)
        if own is None:
            raise HandtrackError(f"camera '{camera}' shows nothing at frame {frame}.")
        return view, own

    def _is_painted(self, camera: str, own_frame: int) -> bool:
        """Return whether a frame was corrected there, and not only carried to it."""
        correction = self.document.in_force(("correction", (camera, own_frame)))
        return correction is not None and not correction.carried

    @Command(job=True, files=True, tunes=True)
    def carry_masks(self, frame: int, camera: str, before: int, behind: int) -> None:
        """Carry what was painted in a frame on to so many frames before and behind it. camera: empty for all."""
        document, store = self.document, self.store
        store.check()
        store.write_what_rests(at_once=True)
        views = [view for view in document.session.views if camera in ("", view.name)]
        first, last = (document.clamped(frame + n) for n in (-before, behind))
        frames = range(first, last + 1)

        def work(job: BackgroundJob) -> None:
            if carried := carry(job, views, frame, frames, self._is_painted):
                job.report(self._take_carried, carried)

        self.jobs.begin("carrying", work)

    def _take_carried(self, corrections: dict[tuple[str, int], Correction]) -> None:
        self.store.do("Corrected masks propagated", decide(correction=corrections))
        many = f"To {len(corrections)} frames; undo reverts it."
        self.publish(Notice("done", "The correction is propagated", many))
