"""The cloud desk: what the page sees of clouds and of the solver's surface, and the settings of [clouds]."""

from __future__ import annotations

import time
from collections.abc import Mapping
from itertools import combinations

from handtrack.capture.clouds.cloud_filters import CloudFilters
from handtrack.capture.clouds.skin_ellipse import fit_skin_ellipse
from handtrack.errors import HandtrackError
from handtrack.session.clouds_settings import CloudSettings
from handtrack_app import messages as m
from handtrack_app.aside import Aside
from handtrack_app.cloud_making import CloudMaker, Moment
from handtrack_app.document import Document, params_of

_HURRIED_S = 0.6  # while tracking runs, clouds are shown at most this often
_PAIRS = 12  # offered for stereo


class CloudDesk:
    """Lives on the worker's thread; what takes time is made aside."""

    def __init__(self, document: Document, aside: Aside) -> None:
        self._document, self._aside = document, aside
        self._wanted = m.WantCloud()
        self._surface = False
        self._shown_at = 0.0
        self._maker = CloudMaker()

    # ---- showing

    def want(self, wish: m.WantCloud | m.WantSurface) -> None:
        """Show something else from now on."""
        if isinstance(wish, m.WantSurface):
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
            self._aside.ask("surface", lambda: maker.surface(moment))
        if cloud and self._wanted.points:
            self._aside.ask("cloud", lambda: maker.cloud(moment))
        if cloud and self._wanted.picture == "images" and not hurried:
            self._aside.ask("picture", lambda: maker.images(moment))
        if stereo and not hurried:
            pair = self._wanted.pair or self.card().pair
            if pair is not None:
                self._aside.ask("picture", lambda: maker.stereo(moment, pair))

    def _moment(self) -> Moment:
        document = self._document
        model, session, frame = document.model, document.run.session, document.frame
        bones = model.bones(params_of(model, document.shown))
        before = frame - 1
        previous = bones if document.is_posed else None
        if before in document.by_hand or before in document.results:
            previous = model.bones(params_of(model, document.pose_at(before)))
        filters = getattr(session, "cloud_filters", CloudFilters())
        return Moment(
            frame, document.version, session, model, bones, previous, filters, self._wanted
        )

    @property
    def _has_clouds(self) -> bool:
        return bool(getattr(self._document.run.session, "has_clouds", False))

    # ---- settings

    @property
    def settings(self) -> CloudSettings | None:
        """The settings of [clouds] in force."""
        return self._document.clouds

    def change(self, values: Mapping[str, object]) -> None:
        """Change settings of [clouds]. Raises HandtrackError, and changes nothing, for what cannot be."""
        self.use((self.settings or CloudSettings()).with_values(values))

    def use(self, settings: CloudSettings | None) -> None:
        """Take other settings of [clouds], all of them."""
        self._document.use_clouds(settings)
        self.show()

    def restore(self) -> None:
        """Go back to the settings of session.toml."""
        self.use(self._document.saved_clouds)

    def sample_skin(self, order: m.SampleSkin) -> str:
        """Take the skin's colour from a box of a frame's image; return a sentence about it."""
        session, frame = self._document.run.session, order.frame
        if order.camera not in session.rig.names:
            raise HandtrackError(f"no camera '{order.camera}' in this session.")
        image = session.image(order.camera, frame)
        if image is None:
            raise HandtrackError(
                f"camera '{order.camera}' has no image of frame {frame} to take the skin's colour from."
            )
        x, y, width, height = (max(int(v), 0) for v in order.box)
        patch = image[y : y + height, x : x + width, ::-1].reshape(-1, 3)
        skin = fit_skin_ellipse(patch, max(float(order.size), 0.1))
        self.change({"skin": skin})
        red, green = skin.mean
        return f"{len(patch)} pixels of {order.camera}: r = {red:.3f}, g = {green:.3f}."

    def card(self) -> m.CloudCard:
        """Return where clouds come from and the settings in force."""
        document, settings = self._document, self.settings
        session = document.run.session
        views = getattr(session, "views", ())
        with_images = tuple(view.name for view in views if view.settings.images is not None)
        pairs = tuple(combinations(with_images, 2))
        source, pair = "", None
        if settings is not None:
            source = "stereo" if settings.stereo else "depth" if settings.depth else "files"
            pairs = (*settings.stereo, *(p for p in pairs if p not in settings.stereo))
            pair = settings.stereo[0] if settings.stereo else None
        if pair is None and pairs:
            pair = pairs[0]
        return m.CloudCard(
            source,
            (settings or CloudSettings()).in_force,
            with_images,
            pairs[:_PAIRS],
            pair,
            {view.name: view.camera.size for view in views},
            document.unsaved_clouds,
            settings,
        )
