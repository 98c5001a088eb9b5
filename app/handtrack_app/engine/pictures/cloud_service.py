"""The cloud service: what the page sees of clouds and of the surface, and the settings of [clouds]."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import fields, replace
from itertools import combinations
from typing import Any

import numpy as np

from handtrack.capture.clouds.cloud_filters import COMPONENTS
from handtrack.capture.clouds.skin_ellipse import fit_skin_ellipse
from handtrack.errors import HandtrackError, unknown_name
from handtrack.session.clouds import cloud_filters, stereo_settings
from handtrack.session.clouds_settings import CloudSettings
from handtrack_app.engine.document import Document, params_of
from handtrack_app.engine.pictures.cloud_renderer import CloudRenderer, RenderInput
from handtrack_app.engine.pictures.render_thread import RenderThread
from handtrack_app.protocol.commands import SampleSkin, WantCloud, WantSurface
from handtrack_app.protocol.snapshots import CloudCard

_HURRIED_S = 0.6  # while tracking runs, clouds are shown at most this often
_PAIRS = 12  # offered for stereo
_OFF = ("near_m", "far_m", "crop_m", "voxel_m", "outlier_neighbours", "max_points", "front_m")


class CloudService:
    """Lives on the worker's thread; what takes time is made on the render thread."""

    def __init__(self, document: Document, render_thread: RenderThread) -> None:
        self._document, self._render_thread = document, render_thread
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
        bones = model.bones(params_of(model, document.shown))
        before = frame - 1
        previous = bones if document.is_posed else None
        if before in document.by_hand or before in document.results:
            previous = model.bones(params_of(model, document.pose_at(before)))
        return RenderInput(
            frame, document.version, session, model, bones, previous, session.cloud_filters,
            self._wanted,
        )  # fmt: skip

    @property
    def _has_clouds(self) -> bool:
        return self._document.run.session.has_clouds

    # ---- settings

    @property
    def settings(self) -> CloudSettings | None:
        """The settings of [clouds] in force."""
        return self._document.clouds

    def change(self, values: Mapping[str, object]) -> None:
        """Change settings of [clouds]. Raises HandtrackError, and changes nothing, for what cannot be."""
        self.use(changed_clouds(self.settings, values))

    def use(self, settings: CloudSettings | None) -> None:
        """Take other settings of [clouds], all of them."""
        self._document.use_clouds(settings)
        self.show()

    def restore(self) -> None:
        """Go back to the settings of session.toml."""
        self.use(self._document.saved_clouds)

    def sample_skin(self, order: SampleSkin) -> str:
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
            shown_values(settings),
            with_images,
            pairs[:_PAIRS],
            pair,
            {view.name: view.camera.size for view in views},
            document.unsaved_clouds,
            settings,
        )


def shown_values(settings: CloudSettings | None) -> dict[str, object]:
    """Return the settings in force by their names in [clouds]; None is off."""
    settings = settings or CloudSettings()
    filters, stereo = cloud_filters(settings), stereo_settings(settings)
    values: dict[str, object] = {f.name: getattr(filters, f.name) for f in fields(filters)}
    return values | {
        "stereo_method": stereo.method,
        "stereo_window_px": getattr(stereo, f"{stereo.method}_window_px"),
        "stereo_left_right_px": stereo.left_right_px,
        "stereo_contrast": stereo.least_contrast,
        "stereo_speckle_px": stereo.speckle_px,
    }


def changed_clouds(settings: CloudSettings | None, values: Mapping[str, object]) -> CloudSettings:
    """Return settings of [clouds] with some replaced. Raises HandtrackError for what cannot be."""
    known = {field.name for field in fields(CloudSettings)}
    for name, value in values.items():
        if name not in known:
            raise HandtrackError(
                f"no setting '{name}' in [clouds]; known: {', '.join(sorted(known))}"
            )
        numeric = isinstance(value, int | float) and not isinstance(value, bool)
        if numeric and not (np.isfinite(value) and value > 0):  # type: ignore[operator]
            raise HandtrackError(f"[clouds], {name}: expected a number above 0, found {value}.")
        if value is False and name not in _OFF:
            raise HandtrackError(f"[clouds], {name}: cannot be switched off.")
    given: dict[str, Any] = dict(values)
    if given.get("component", COMPONENTS[0]) not in (None, *COMPONENTS):
        raise unknown_name("part of a cloud", str(given["component"]), COMPONENTS)
    if given.get("front_m") is False:  # off is how it usually is
        given["front_m"] = None
    if given.get("stereo"):  # a session has one source of clouds
        given |= {"files": None, "depth": ()}
    changed = replace(settings or CloudSettings(), **given)
    filters = cloud_filters(changed)
    if (filters.near_m or 0.0) >= (filters.far_m or np.inf):
        raise HandtrackError(
            f"[clouds]: near_m = {filters.near_m:g} and far_m = {filters.far_m:g}; expected near_m < far_m."
        )
    stereo_settings(changed)  # says what is wrong with it
    return changed
