"""Clouds: the frame's pictures first, what each filter dropped, how the cloud is drawn, and saving the settings."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import viser

from handtrack.capture.clouds.cloud_filters import SkinEllipse
from handtrack.session.session_file import CLOUD_SETTINGS
from handtrack_app.page.html import chip, escaped, line, picture, pictures, rgb, table, text
from handtrack_app.page.page import Client, Panel, Part, put
from handtrack_app.page.panels.settings import SavedSettings, SettingWidget
from handtrack_app.palette import FILTERS, KEPT, RESIDUAL_MM, residual_colours
from handtrack_app.protocol import (
    Box,
    CloudCard,
    CloudPicture,
    CloudSnapshot,
    SessionSnapshot,
)

_COLOURS = {"distance to model": "residual", "measured colour": "own", "plain": "plain"}
_PICTURES = {"cameras and points": "images", "stereo match": "stereo", "none": "none"}
_FILTER_WORDS = {
    "range": "sensor's range", "crop": "near the last hand", "skin": "skin colour", "component": "connected part",
    "voxel": "cells", "outliers": "outliers", "most": "at most",
}  # fmt: skip


CROP = ("near_m", "far_m", "crop_m", "component", "front_m")
THIN = ("voxel_m", "per_voxel", "outlier_neighbours", "outlier_ratio", "max_points")
STEREO = (
    "stereo_method", "stereo_window_px", "stereo_left_right_px", "stereo_contrast", "stereo_speckle_px",
)  # fmt: skip
_LABELS = {"component": "Part"}
"""where the page has a shorter one"""


@dataclass
class CloudPanel(Panel):
    """Handles of the cloud tab, and of the large picture above the scene."""

    mark: Callable[..., None]
    """`Stage.mark_box`"""
    large_picture: viser.GuiHtmlHandle | None = None
    known: dict[str, SettingWidget] = field(default_factory=dict)
    """settings of [clouds]; 0 switches a filter off"""
    skin: SkinControls | None = None

    def build(self) -> None:
        page, gui, display = self.page, self.gui, self.state.display
        card = self.state.session.clouds
        self.picture = page.offer(
            gui.add_html(""), lambda: display.cloud_picture != "none" and not display.cloud_wide
        )
        self.said = gui.add_html("")
        self.counts = gui.add_html("")
        page.reflect(gui.add_html(""), content=lambda: _note(self.state.session.clouds))
        self.which = page.choice(
            "Picture", _PICTURES, partial(page.draw, "cloud_picture"),
            "Cameras: each point in the colour of the filter that dropped it; yellow ones stay.",
        )  # fmt: skip
        self.wide = page.toggle("Large", "cloud_wide", "Over the scene.")
        for widget in (self.which, self.wide):
            page.offer(widget, lambda: len(self.which.options) > 1)
        with page.offer(gui.add_folder("In the scene"), self.has_clouds):
            self.on = page.toggle("Cloud", "cloud")
            page.choice(
                "Colour", _COLOURS, partial(page.draw, "cloud_colour"),
                "Distance to the model: blue inside, grey on its surface, orange outside.",
            )  # fmt: skip
            size = gui.add_slider("Point mm", 0.4, 6.0, 0.2, display.cloud_size_mm)
            page.bind(size, partial(page.draw, "cloud_size_mm"))
            self.legend = page.offer(
                gui.add_html(ramp_legend()), lambda: display.cloud_colour == "residual"
            )
        with page.offer(gui.add_folder("Crop"), self.has_clouds):
            self._add(*CROP)
        thin = gui.add_folder("Thin, and drop outliers", expand_by_default=False)
        with page.offer(thin, self.has_clouds):
            self._add(*THIN)
        if card.image_cameras:  # else there is no colour
            self.skin = SkinControls(page, self)
        if card.pairs:
            with gui.add_folder("Stereo", expand_by_default=not card.source):
                pairs = {" – ".join(pair): pair for pair in card.pairs}
                first = " – ".join(card.pairs[0])
                page.choice("Pair", pairs, partial(page.draw, "stereo_pair"), now=first)
                self._add(*STEREO)
                page.button(
                    "Clouds from this pair", lambda: self.set(stereo=(self.pair,)), "arrow-merge",
                    "Computes the session's clouds from these two cameras, in place of any pair before.", when=self._is_other_pair,
                )  # fmt: skip
        self.saved = SavedSettings(
            page, "clouds", "the table [clouds]", "Discards unsaved changes."
        )  # fmt: skip

    def fit(self, session: SessionSnapshot) -> None:
        """Show the settings in force."""
        card = session.clouds
        for name, one in self.known.items():
            one.show(card.values.get(name))
        self.known["front_m"].widget.disabled = card.values.get("component") != "nearest"
        if self.skin is not None:
            self.skin.fit(card)
        if not card.source:
            self.counts.content = ""
        # the pictures that there are
        some = {"images": bool(card.source), "stereo": bool(card.pairs), "none": True}
        words = {w: p for w, p in _PICTURES.items() if some[p]}
        wished = self.state.display.cloud_picture
        shown = next((w for w, p in words.items() if p == wished), "none")
        put(self.which, options=tuple(words), value=shown)

    def _add(self, *names: str) -> None:
        """Add settings where the page builds now."""
        for name in names:
            setting = CLOUD_SETTINGS[name]
            setting = replace(setting, label=_LABELS.get(name, setting.label))
            act: Callable[[object], None] = lambda value, name=name: self.set(**{name: value})  # noqa: E731
            self.known[name] = SettingWidget(self.page, setting, act)

    @property
    def pair(self) -> tuple[str, str] | None:
        """The pair that is looked at."""
        return self.state.display.stereo_pair or self.state.session.clouds.pair

    def _is_other_pair(self) -> bool:
        card = self.state.session.clouds
        return card.source != "stereo" or self.pair != card.pair

    def has_clouds(self) -> bool:
        """Return whether the session has clouds."""
        return bool(self.state.session.clouds.source)

    def set(self, **values: object) -> None:
        """Change settings of [clouds]."""
        self.engine.set_clouds(values)

    def mark_box(self, camera: str, client: Client, marked: Callable[..., None]) -> None:
        """Have a box dragged over a camera's image; the large picture would stand before it."""
        self.page.draw("cloud_wide", False)
        self.wide.value = False
        self.mark(camera, client, "skin, away from its edges", marked)

    # ---- snapshots

    def show(self, cloud: CloudSnapshot) -> None:
        """Say what the filters did to a frame's cloud."""
        self.counts.content = counts_table(cloud)
        self.legend.content = ramp_legend(cloud)

    def show_picture(self, cloud: CloudPicture) -> None:
        """Show the pictures of a frame's cloud."""
        widget, kind = (self._large(), "handtrack-picture") if cloud.wide else (self.picture, "")
        shown = {name: picture(one, name) for name, one in cloud.images.items()}
        widget.content = pictures(shown, kind)
        self.said.content = escaped(cloud.words)

    def _large(self) -> viser.GuiHtmlHandle:
        if self.large_picture is None:
            gui = self.gui
            panel, display = gui.add_panel(), self.state.display
            with panel.add_tab("Picture"):
                self.large_picture = gui.add_html("")
            panel.float(x=16, y=16, width=560)
            self.page.reflect(
                panel, visible=lambda: display.cloud_picture != "none" and display.cloud_wide
            )
        return self.large_picture


def _note(card: CloudCard) -> str:
    if card.source:
        return ""
    text = "This session has no clouds."
    if card.pairs:
        text += " Choose a pair below and press 'Clouds from this pair' to match its images."
    else:
        text += (
            " Add a table [clouds] to session.toml: from files, depth images or pairs of cameras."
        )
    return escaped(text)


def counts_table(cloud: CloudSnapshot) -> str:
    """Return how many points each filter got and left, as bars."""
    most = max(cloud.measured, 1)
    rows = [_row("measured", "all points of this frame", None, cloud.measured, most, "")]
    for count in cloud.counts:
        colour = FILTERS.get(count.name, FILTERS["range"])
        word = _FILTER_WORDS.get(count.name, count.name)
        lost = f"−{_grouped(count.before - count.after)}" if count.before > count.after else ""
        rows.append(_row(word, count.text, colour, count.after, most, lost))
    rows.append(_row("for the tracker", "remaining points", KEPT, cloud.left, most, ""))
    name = text(f"<b>Cloud of frame {cloud.frame}</b>", faint=False)
    return name + table("".join(rows)) + escaped(cloud.words)


def _row(
    word: str, text: str, colour: tuple[int, int, int] | None, after: int, most: int, lost: str
) -> str:
    dot = "" if colour is None else chip(rgb(colour))
    bar = f"linear-gradient(90deg,rgba(86,180,233,.35) {100 * after / most:.1f}%,rgba(128,128,128,.12) 0)"
    return (
        f"<tr title='{html.escape(text)}' style='background:{bar}'>"
        f"<td style='padding-left:.2em'>{dot}{html.escape(word)}</td>"
        f"<td class='handtrack-number'>{lost}</td><td class='handtrack-number'>{_grouped(after)}</td></tr>"
    )


def _grouped(count: int) -> str:
    return f"{count:,}".replace(",", "\u202f")


def ramp_legend(cloud: CloudSnapshot | None = None) -> str:
    """Return what the colours of distances mean [mm], and how far the points are in the middle."""
    steps = np.linspace(-RESIDUAL_MM, RESIDUAL_MM, 9)
    stops = ",".join(map(rgb, residual_colours(steps)))
    said = ""
    if cloud is not None and np.isfinite(cloud.residual_mm).any():
        off = np.abs(cloud.residual_mm[np.isfinite(cloud.residual_mm)])
        middle, most = np.quantile(off, [0.5, 0.9])
        said = line(f"half within {middle:.1f} mm, 90 % within {most:.1f} mm")
    return text(
        f"<div style='height:.7em;border-radius:3px;background:linear-gradient(90deg,{stops})'></div>"
        "<div class='handtrack-row handtrack-faint'>"
        f"<span>−{RESIDUAL_MM:.0f} mm inside</span><span>0</span><span>outside +{RESIDUAL_MM:.0f} mm</span></div>{said}",
        faint=False,
    )


# ---- Skin colour: an ellipse in (r, g) fitted to a box on an image, with its size as the threshold


_SIZE = (0.5, 10.0, 0.1)


@dataclass
class SkinControls(Part):
    """Where the colour is taken from, and how far from it counts."""

    panel: CloudPanel
    ellipse: SkinEllipse | None = None
    """in force, or before it was switched off"""

    def build(self) -> None:
        page, gui = self.page, self.gui
        folder = gui.add_folder("Skin colour", expand_by_default=False)
        with page.offer(folder, self.panel.has_clouds):
            self.words = gui.add_html("")
            self.on = page.check(
                "Skin only", False, lambda on: self.panel.set(skin=self.ellipse if on else None), "Drop points of other colours.",
                lambda: self.ellipse is not None,
            )  # fmt: skip
            self.size = page.bind(
                gui.add_slider(
                    "Ellipse's size", *_SIZE, 2.5,
                    hint="The threshold, in standard deviations of the samples' (r, g).",
                ),
                self._resize,
            )  # fmt: skip
            self.camera = page.choice(
                "Box in", self.state.session.clouds.image_cameras, lambda _: None
            )
            self.drag = page.button(
                "Drag a box over the image", self._drag, "marquee-2",
                "Opens the camera view; drag over skin, away from its edges.", by_page=True,
            )  # fmt: skip
            page.button(
                "Learn it from painted masks", lambda: self.take(None), "brush",
                "Uses every camera and frame that you painted in the Masks tab.",
            )  # fmt: skip

    def _drag(self, client: Client) -> None:
        self.panel.mark_box(str(self.camera.value), client, self.take)

    def _resize(self, size: float) -> None:
        if self.on.value and self.ellipse is not None:
            self.panel.set(skin=replace(self.ellipse, size=round(size, 3)))

    def take(self, box: Box | None) -> None:
        """Take the colour in a box of the camera's image, or in what was painted."""
        frame, camera = self.state.frame, self.camera.value
        self.engine.sample_skin(frame, camera, box, self.size.value)

    def fit(self, card: CloudCard) -> None:
        """Show the ellipse in force."""
        skin, words = card.values.get("skin"), "not taken yet"
        if isinstance(skin, SkinEllipse):
            self.ellipse, words = skin, f"r {skin.mean[0]:.3f}, g {skin.mean[1]:.3f}"
            put(self.size, value=min(max(skin.size, _SIZE[0]), _SIZE[1]))
        put(self.on, value=skin is not None)
        put(self.words, content=escaped(f"Colour of skin: {words}"))
