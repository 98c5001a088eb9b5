"""The cloud service: what the page sees of clouds and of the surface, and the settings of [clouds]."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from itertools import combinations

from handtrack.capture.clouds.skin_ellipse import fit_skin_ellipse
from handtrack.errors import HandtrackError
from handtrack.session.clouds_settings import CloudSettings
from handtrack.session.seen.skin_samples import painted_skin
from handtrack_app.engine.document import Document
from handtrack_app.engine.job_control import JobControl
from handtrack_app.engine.pictures.cloud_renderer import CloudRenderer, RenderInput
from handtrack_app.engine.pictures.render_thread import RenderThread
from handtrack_app.engine.posing.page_values import params_of
from handtrack_app.engine.store import edits, saving
from handtrack_app.engine.store.persistence import Persistence
from handtrack_app.protocol import commands
from handtrack_app.protocol.commands import SampleSkin, WantCloud, WantSurface
from handtrack_app.protocol.snapshots import CloudCard, Notice, Snapshot

CloudChange = (
    commands.SetClouds | commands.SampleSkin | commands.RestoreClouds | commands.SaveClouds
)

_HURRIED_S = 0.6  # while tracking runs, clouds are shown at most this often
_PAIRS = 12  # offered for stereo


class CloudService:
    """Lives on the worker's thread; what takes time is made on the render thread."""

    def __init__(
        self,
        document: Document,
        store: Persistence,
        jobs: JobControl,
        render_thread: RenderThread,
        publish: Callable[[Snapshot], None],
    ) -> None:
        self._document, self._render_thread = document, render_thread
        self._store, self._jobs, self._publish = store, jobs, publish
        self._wanted = WantCloud()
        self._surface = False
        self._shown_at = 0.0
        self._maker = CloudRenderer()

    # ---- showing

    def want(self, wish: WantCloud | WantSurface) -> None:
        """Show something else from now on."""
        if isinstance(wish, WantSurface):
            self._surface = wish.on
        else:
            self._wanted = wish
        self.show()

    def show(self, hurried: bool = False) -> None:
        """Have made what the page wants of the pose shown. hurried: tracking runs, which comes first."""
        cloud = self._has_clouds and (self._wanted.points or self._wanted.picture == "images")
        stereo = self._wanted.picture == "stereo"
        now = time.monotonic()
        if not (self._surface or cloud or stereo) or (
            hurried and now - self._shown_at < _HURRIED_S
        ):
            return
        self._shown_at = now
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
        bones = model.bones(params_of(model, document.seen))
        before = frame - 1
        previous = bones if document.is_posed else None
        if before in document.by_hand or before in document.results:
            previous = model.bones(params_of(model, document.pose_at(before)))
        return RenderInput(
            frame, document.version, session, model, bones, previous, session.cloud_filters,
            self._wanted, document.run.settings.cloud,
        )  # fmt: skip

    @property
    def _has_clouds(self) -> bool:
        return self._document.run.session.has_clouds

    # ---- settings

    def tell(self) -> None:
        """Say where clouds come from."""
        self._publish(self.card())

    def serve(self, change: CloudChange) -> None:
        """Change, save or restore the settings of [clouds]. Raises HandtrackError."""
        store = self._store
        try:
            self._jobs.require_idle()
            match change:
                case commands.SetClouds():
                    names = ", ".join(name for name, _ in change.values)
                    settings = self.with_values(dict(change.values))
                    slid = edits.is_slid(*(value for _, value in change.values))
                    clouds = edits.clouds(settings)
                    store.do(f"Clouds: {names}", clouds, tag=names, is_stroke=slid)
                case commands.SampleSkin():
                    settings, words = skin_in_force(self._document, change)
                    store.do("Colour of skin", edits.clouds(settings), tag="skin")
                    self._publish(Notice("done", "The skin's colour is taken", words))
                case commands.RestoreClouds():
                    own = edits.clouds(self._document.saved_clouds)
                    store.do("Filters of session.toml", own)
                case commands.SaveClouds():
                    said = saving.save_clouds(store)
                    self._publish(Notice("done", "Clouds' settings saved", said))
            self.show()
        finally:
            self.tell()  # the page shows what holds

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


def skin_in_force(document: Document, order: SampleSkin) -> tuple[CloudSettings, str]:
    """Return the settings of [clouds] with the skin's colour from a box of a frame's image or from painted masks, and a sentence
    about it. Raises HandtrackError.
    """
    session, frame, size = document.run.session, order.frame, max(float(order.size), 0.1)
    if order.box is None:
        patches = painted_skin(session)
        source = "1 painted image" if len(patches) == 1 else f"{len(patches)} painted images"
    else:
        if order.camera not in session.rig.names:
            raise HandtrackError(f"no camera '{order.camera}' in this session.")
        image = session.image(order.camera, frame)
        if image is None:
            raise HandtrackError(
                f"camera '{order.camera}' has no image of frame {frame} to take the skin's colour from."
            )
        x, y, width, height = (max(int(v), 0) for v in order.box)
        patches, source = [image[y : y + height, x : x + width, ::-1]], order.camera
    skin = fit_skin_ellipse(*patches, size=size)
    red, green = skin.mean
    words = (
        f"{sum(p.size // 3 for p in patches)} pixels of {source}: r = {red:.3f}, g = {green:.3f}."
    )
    return (document.clouds or CloudSettings()).with_values({"skin": skin}), words
