"""The mask desk: what the page sees of masks, where they come from, and what is painted over them."""

from __future__ import annotations

import time
from collections.abc import Callable

from handtrack.capture.masks.segmentation import mask_method_table
from handtrack_app.engine.document import Document
from handtrack_app.engine.job_control import JobControl
from handtrack_app.engine.masks import mask_edits
from handtrack_app.engine.masks.carrying_job import CarryingJob
from handtrack_app.engine.masks.mask_renderer import MaskMoment, MaskRenderer
from handtrack_app.engine.pictures.render_thread import RenderThread
from handtrack_app.engine.store import edits, keys, saving
from handtrack_app.engine.store.persistence import Persistence
from handtrack_app.protocol import commands
from handtrack_app.protocol.mask_commands import FILES, NO_MASKS
from handtrack_app.protocol.masks import MaskCameraCard, MaskCard, MaskPicture
from handtrack_app.protocol.snapshots import Notice, Snapshot

MaskChange = (
    commands.SetMasks
    | commands.MarkMaskBox
    | commands.SaveMasks
    | commands.RestoreMasks
    | commands.PaintMask
    | commands.DropCorrection
    | commands.CarryMasks
)
_HURRIED_S = 0.6  # while tracking runs, masks are shown at most this often
_MOST_CARRIED = 50  # frames each way; what is carried drifts
_NO_IMAGES = "No camera of this recording has images: its masks cannot be computed, nor seen against anything."
_FILES = "Masks of {} are files. Choose a method to compute them from the images, or correct them below: the files stay."


class MaskService:
    """Lives on the worker's thread; what takes time is made on the render thread or by a job."""

    def __init__(
        self,
        document: Document,
        store: Persistence,
        jobs: JobControl,
        render_thread: RenderThread,
        publish: Callable[[Snapshot], None],
    ) -> None:
        self._document, self._store, self._jobs = document, store, jobs
        self._render_thread, self._publish = render_thread, publish
        self._maker = MaskRenderer(document.run.session)
        self._on_all, self._screens = False, tuple[str, ...]()
        self._shown_at = 0.0

    # ---- showing

    def want(self, wish: commands.WantMasks | commands.WantPictures) -> None:
        """Show something else from now on."""
        if isinstance(wish, commands.WantMasks):
            self._on_all = wish.on
        else:
            names = self._document.run.session.rig.names
            wanted = (name for name, paint in wish.screens if paint == "mask")
            self._screens = tuple(name for name in wanted if name in names)
        self.show()

    def show(self, hurried: bool = False) -> None:
        """Have made what the page wants of the frame shown. hurried: tracking runs, which comes first."""
        now = time.monotonic()
        if not (self._on_all or self._screens) or (hurried and now - self._shown_at < _HURRIED_S):
            return
        self._shown_at = now
        moment = self._moment()
        self._render_thread.ask("masks", lambda: self._maker.picture(moment))

    def picture(self) -> MaskPicture | None:
        """Return what the page wants of the frame shown; None where it wants nothing. Takes its time."""
        if not (self._on_all or self._screens):
            return None
        moment = self._moment()
        made = self._render_thread.wait_for("masks", lambda: self._maker.picture(moment))
        return made if isinstance(made, MaskPicture) else None

    def _moment(self) -> MaskMoment:
        document = self._document
        return MaskMoment(document.frame, document.run.session, self._on_all, self._screens)

    def tell(self) -> None:
        """Say where masks come from."""
        self._publish(self.card())

    def card(self) -> MaskCard:
        """Return where masks come from, with the settings in force."""
        document = self._document
        views = document.run.session.views
        cards = []
        for view in views:
            masks, roi = document.masks[view.name]
            table = {} if masks is None or isinstance(masks, str) else mask_method_table(masks)
            table.pop("method", None)
            cards.append(
                MaskCameraCard(
                    view.name, view.camera.size, mask_edits.method_of((masks, roi)), table, roi,
                    mask_edits.possible_methods(document, view),
                )
            )  # fmt: skip
        words = ""
        if all(set(card.possible) <= {FILES, NO_MASKS} for card in cards):
            words = _NO_IMAGES
        elif files := [card.name for card in cards if card.method == FILES]:
            words = _FILES.format(", ".join(files))
        return MaskCard(tuple(cards), document.unsaved_masks, words)

    # ---- changing

    def serve(self, change: MaskChange) -> None:
        """Do what is asked. Raises HandtrackError for what cannot be done."""
        document, store = self._document, self._store
        try:
            self._jobs.require_idle()
            match change:
                case commands.SetMasks():
                    names = ", ".join(name for name, _ in change.values)
                    values = mask_edits.masks(document, change)
                    slid = edits.is_slid(*(value for _, value in change.values))
                    store.do(
                        f"Masks: {names}", values, tag=f"{change.camera} {names}", is_stroke=slid
                    )
                case commands.MarkMaskBox():
                    store.do("Masks: box", mask_edits.marked_box(document, change))
                case commands.RestoreMasks():
                    back = {keys.masks(name): None for name in document.unsaved_masks}
                    store.do("Masks of session.toml", back)
                case commands.SaveMasks():
                    said = saving.save_masks(store)
                    self._publish(Notice("done", "Masks' settings saved", said))
                case _:
                    store.check()  # what is painted becomes a file
                    self._correct(change)
            self.show()
        finally:
            self.tell()  # the page shows what holds

    def _correct(
        self, change: commands.PaintMask | commands.DropCorrection | commands.CarryMasks
    ) -> None:
        document, store = self._document, self._store
        match change:
            case commands.PaintMask():
                values = mask_edits.painting(document, change)
                words = f"Mask of {change.camera}, frame {change.frame}"
                store.do(words, values, f"{words} {change.tag}", waits=True, is_stroke=True)
            case commands.DropCorrection():
                values = mask_edits.dropped(document, change.camera, change.frame)
                store.do(f"Correction of {change.camera} dropped, frame {change.frame}", values)
            case commands.CarryMasks():
                store.write_what_rests(at_once=True)
                views = [
                    view for view in document.run.session.views if change.camera in ("", view.name)
                ]
                before, behind = (
                    min(max(n, 0), _MOST_CARRIED) for n in (change.before, change.behind)
                )
                frame = document.clamped(change.frame)
                frames = range(
                    document.clamped(frame - before), document.clamped(frame + behind) + 1
                )
                self._jobs.begin(
                    lambda number, post: CarryingJob(
                        number, views, frame, frames,
                        lambda name, own: mask_edits.is_painted(document, name, own), post,
                    )
                )  # fmt: skip
