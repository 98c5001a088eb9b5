"""The mask desk: what the page sees of masks, where they come from, and what is painted over them."""

from __future__ import annotations

from functools import cached_property

from handtrack.capture.masks.segmentation import mask_method_table
from handtrack.session.session_state import decide
from handtrack_app.engine.masks import mask_edits
from handtrack_app.engine.masks.carrying_job import CarryingJob
from handtrack_app.engine.masks.mask_renderer import MaskMoment, MaskRenderer
from handtrack_app.engine.pictures.preview_service import PreviewService
from handtrack_app.engine.store import edits, saving
from handtrack_app.protocol.calls import command
from handtrack_app.protocol.masks import FILES, NO_MASKS, MaskCameraCard, MaskCard, MaskPicture
from handtrack_app.protocol.snapshots import Notice

_MOST_CARRIED = 50  # frames each way; what is carried drifts
_NO_IMAGES = "No camera of this recording has images: its masks cannot be computed, nor seen against anything."
_FILES = "Masks of {} are files. Choose a method to compute them from the images, or correct them below: the files stay."


class MaskService(PreviewService):
    """Masks."""

    _on_all, _screens = False, tuple[str, ...]()

    @cached_property
    def _maker(self) -> MaskRenderer:
        return MaskRenderer(self._document.run.session)

    # ---- showing

    @command(view=True, latest=())
    def want_masks(self, on: bool) -> None:
        """Show masks over all cameras' images or not."""
        self._on_all = on
        self.show()

    def want_screens(self, screens: tuple[tuple[str, str], ...]) -> None:
        """Show the masks of these cameras whose large pictures are looked at."""
        names = self._document.run.session.rig.names
        wanted = (name for name, paint in screens if paint == "mask")
        self._screens = tuple(name for name in wanted if name in names)
        self.show()

    @property
    def _is_wanted(self) -> bool:
        return self._on_all or bool(self._screens)

    def _show(self, hurried: bool) -> None:
        moment = self._moment()
        self._render_thread.ask("masks", lambda: self._maker.picture(moment))

    def picture(self) -> MaskPicture | None:
        """Return what the page wants of the frame shown; None where it wants nothing. Takes its time."""
        if not self._is_wanted:
            return None
        moment = self._moment()
        made = self._render_thread.wait_for("masks", lambda: self._maker.picture(moment))
        return made if isinstance(made, MaskPicture) else None

    def _moment(self) -> MaskMoment:
        document = self._document
        return MaskMoment(document.frame, document.run.session, self._on_all, self._screens)

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

    @command(edits=True, latest=("camera", "values"), words="settings of masks")
    def set_masks(self, camera: str, values: dict[str, object]) -> None:
        """Change where the masks of a camera come from (`method`), settings of the method, or the region of interest (`roi`). camera:
        empty for all that have what it takes.
        """
        names, slid = ", ".join(values), edits.is_slid(*values.values())

        def change() -> None:
            changed = mask_edits.masks(self._document, camera, values)
            self._store.do(f"Masks: {names}", changed, tag=f"{camera} {names}", is_stroke=slid)

        self._change(change)

    @command(edits=True, words="a box for masks")
    def mark_mask_box(
        self, camera: str, what: str, box: tuple[int, int, int, int], frame: int
    ) -> None:
        """Take a box x, y, w, h [px] of a camera's undistorted image as region of interest (`roi`) or as skin (`sample`)."""
        self._change(
            lambda: self._store.do(
                "Masks: box", mask_edits.marked_box(self._document, camera, what, box, frame)
            )
        )

    @command(edits=True, words="settings of masks")
    def restore_masks(self) -> None:
        """Go back to the masks as session.toml has them."""
        back = dict.fromkeys(self._document.unsaved_masks)
        self._change(lambda: self._store.do("Masks of session.toml", decide(masks=back)))

    @command(edits=True, files=True, words="saving settings of masks")
    def save_masks(self) -> None:
        """Write where masks come from into session.toml."""

        def change() -> None:
            said = saving.save_masks(self._store)
            self._publish(Notice("done", "Masks' settings saved", said))

        self._change(change)

    @command(edits=True, files=True, words="the mask of {camera}, frame {frame}")
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

        def change() -> None:
            self._store.check()  # what is painted becomes a file
            values = mask_edits.painting(self._document, frame, camera, brush, points, radius_px)
            self._store.do(words, values, f"{words} {tag}", waits=True, is_stroke=True)

        self._change(change)

    @command(edits=True, files=True, words="the mask of {camera}, frame {frame}")
    def drop_correction(self, frame: int, camera: str) -> None:
        """Forget what was painted over a camera's mask in a frame."""

        def change() -> None:
            self._store.check()
            values = mask_edits.dropped(self._document, camera, frame)
            self._store.do(f"Correction of {camera} dropped, frame {frame}", values)

        self._change(change)

    @command(job=True, files=True, words="carrying masks on")
    def carry_masks(self, frame: int, camera: str, before: int, behind: int) -> None:
        """Carry what was painted in a frame on to so many frames before and behind it. camera: empty for all."""
        document, store = self._document, self._store

        def change() -> None:
            store.check()
            store.write_what_rests(at_once=True)
            views = [view for view in document.run.session.views if camera in ("", view.name)]
            low, high = (min(max(n, 0), _MOST_CARRIED) for n in (before, behind))
            at = document.clamped(frame)
            frames = range(document.clamped(at - low), document.clamped(at + high) + 1)
            self._jobs.begin(
                lambda number, post: CarryingJob(
                    number, views, at, frames,
                    lambda name, own: mask_edits.is_painted(document, name, own), post,
                )
            )  # fmt: skip

        self._change(change)
