"""The cloud service: what the page sees of clouds and of the surface, and the settings of [clouds]."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from itertools import combinations

from handtrack.capture.clouds.skin_ellipse import fit_skin_ellipse
from handtrack.errors import HandtrackError
from handtrack.session.clouds_settings import CloudSettings
from handtrack.session.posed_frames import solver_params_of
from handtrack.session.sources.skin_samples import painted_skin
from handtrack_app.engine.document import Document
from handtrack_app.engine.pictures.cloud_renderer import CloudRenderer, RenderInput
from handtrack_app.engine.pictures.preview_service import PreviewService
from handtrack_app.engine.store import edits, saving
from handtrack_app.protocol.calls import command
from handtrack_app.protocol.snapshots import CloudCard, CloudSelection, Notice

_PAIRS = 12  # offered for stereo


class CloudService(PreviewService):
    """Clouds, and the surface that the solver fits to them."""

    _wanted, _surface = CloudSelection(), False

    @cached_property
    def _maker(self) -> CloudRenderer:
        return CloudRenderer()

    # ---- showing

    @command(view=True, latest=())
    def want_surface(self, on: bool) -> None:
        """Show the solver's surface or not."""
        self._surface = on
        self.show()

    @command(view=True, latest=())
    def want_cloud(self, view: CloudSelection) -> None:
        """Show this of clouds from now on."""
        self._wanted = view
        self.show()

    @property
    def _wants_cloud(self) -> bool:
        return self._has_clouds and (self._wanted.points or self._wanted.picture == "images")

    @property
    def _is_wanted(self) -> bool:
        return self._surface or self._wants_cloud or self._wanted.picture == "stereo"

    def _show(self, hurried: bool) -> None:
        cloud, stereo = self._wants_cloud, self._wanted.picture == "stereo"
        moment, maker = self._moment(), self._maker
        if self._surface and not hurried and "metaballs" in moment.model.flesh:
            self._render_thread.ask("surface", lambda: maker.surface(moment))
        if cloud and self._wanted.points:
            self._render_thread.ask("cloud", lambda: maker.cloud(moment))
        if cloud and self._wanted.picture == "images" and not hurried:
            self._render_thread.ask("picture", lambda: maker.images(moment))
        if stereo and not hurried:
            pair = self._wanted.pair or self.card().pair
            if pair is not None:
                self._render_thread.ask("picture", lambda: maker.stereo(moment, pair))

    def _moment(self) -> RenderInput:
        document = self._document
        model, session, frame = document.model, document.run.session, document.frame
        bones = model.bones(solver_params_of(model, document.seen))
        before = frame - 1
        previous = bones if document.is_posed else None
        if before in document.by_hand or before in document.results:
            previous = model.bones(solver_params_of(model, document.pose_at(before)))
        return RenderInput(
            frame, document.version, session, model, bones, previous, session.cloud_filters,
            self._wanted, document.run.settings.cloud,
        )  # fmt: skip

    @property
    def _has_clouds(self) -> bool:
        return self._document.run.session.has_clouds

    # ---- settings

    @command(edits=True, latest=("values",), words="settings of clouds")
    def set_clouds(self, values: dict[str, object]) -> None:
        """Change settings of [clouds] by name; None: as it is usual, False: off."""
        names, slid = ", ".join(values), edits.is_slid(*values.values())
        self._change(
            lambda: self._store.do(
                f"Clouds: {names}",
                edits.clouds(self.with_values(values)),
                tag=names,
                is_stroke=slid,
            )
        )

    @command(edits=True, latest=(), words="the colour of skin")
    def sample_skin(
        self, frame: int, camera: str, box: tuple[int, int, int, int] | None, size: float
    ) -> None:
        """Fit the skin's ellipse to a box x, y, w, h [px] of a camera's image of a frame; None: to all images in which hand is painted."""

        def change() -> None:
            settings, words = skin_in_force(self._document, frame, camera, box, size)
            self._store.do("Colour of skin", edits.clouds(settings), tag="skin")
            self._publish(Notice("done", "The skin's colour is taken", words))

        self._change(change)

    @command(edits=True, words="settings of clouds")
    def restore_clouds(self) -> None:
        """Go back to the settings of [clouds] as session.toml has them."""
        own = edits.clouds(self._document.saved_clouds)
        self._change(lambda: self._store.do("Filters of session.toml", own))

    @command(edits=True, files=True, words="saving settings of clouds")
    def save_clouds(self) -> None:
        """Write the settings of [clouds] into session.toml."""

        def change() -> None:
            said = saving.save_clouds(self._store)
            self._publish(Notice("done", "Clouds' settings saved", said))

        self._change(change)

    @property
    def settings(self) -> CloudSettings | None:
        """The settings of [clouds] in force."""
        return self._document.clouds

    def with_values(self, values: Mapping[str, object]) -> CloudSettings:
        """Return the settings with some replaced. Raises HandtrackError."""
        return (self.settings or CloudSettings()).with_values(values)

    def card(self) -> CloudCard:
        """Return where clouds come from and the settings in force."""
        document, settings = self._document, self.settings
        session = document.run.session
        views = session.views
        with_images = tuple(view.name for view in views if view.settings.images is not None)
        pairs = tuple(combinations(with_images, 2))
        source, pair = "", None
        if settings is not None:
            source = "stereo" if settings.stereo else "depth" if settings.depth else "files"
            pairs = (*settings.stereo, *(p for p in pairs if p not in settings.stereo))
            pair = settings.stereo[0] if settings.stereo else None
        if pair is None and pairs:
            pair = pairs[0]
        return CloudCard(
            source,
            (settings or CloudSettings()).in_force,
            with_images,
            pairs[:_PAIRS],
            pair,
            {view.name: view.camera.size for view in views},
            document.unsaved_clouds,
            settings,
        )


def skin_in_force(
    document: Document, frame: int, camera: str, box: tuple[int, int, int, int] | None, size: float
) -> tuple[CloudSettings, str]:
    """Return the settings of [clouds] with the skin's colour from a box of a frame's image or from painted masks, and a sentence
    about it. Raises HandtrackError.
    """
    session, size = document.run.session, max(float(size), 0.1)
    if box is None:
        patches = painted_skin(session)
        source = "1 painted image" if len(patches) == 1 else f"{len(patches)} painted images"
    else:
        if camera not in session.rig.names:
            raise HandtrackError(f"no camera '{camera}' in this session.")
        image = session.image(camera, frame)
        if image is None:
            raise HandtrackError(
                f"camera '{camera}' has no image of frame {frame} to take the skin's colour from."
            )
        x, y, width, height = (max(int(v), 0) for v in box)
        patches, source = [image[y : y + height, x : x + width, ::-1]], camera
    skin = fit_skin_ellipse(*patches, size=size)
    red, green = skin.mean
    words = (
        f"{sum(p.size // 3 for p in patches)} pixels of {source}: r = {red:.3f}, g = {green:.3f}."
    )
    return (document.clouds or CloudSettings()).with_values({"skin": skin}), words
