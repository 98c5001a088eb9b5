"""Clouds: the frame's pictures first, what each filter dropped, how the cloud is drawn, and saving the settings."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import viser

from handtrack_app.page.page import Page, number, put
from handtrack_app.page.panels.cloud_filters import FilterControls, StereoControls
from handtrack_app.page.panels.skin import SkinControls
from handtrack_app.protocol.palette import FILTERS, KEPT, RESIDUAL_MM, residual_colours
from handtrack_app.protocol.snapshots import CloudCard, CloudPicture, CloudSnapshot, FilterCount

_COLOURS = {"distance to the model": "residual", "its own": "own", "plain": "plain"}
_PICTURES = {"cameras and points": "images", "stereo match": "stereo", "none": "none"}
_FILTER_WORDS = {
    "range": "sensor's range", "crop": "near the last hand", "skin": "skin colour", "component": "one part",
    "voxel": "cells", "outliers": "outliers", "most": "at most",
}  # fmt: skip


@dataclass
class CloudPanel:
    """Handles of the cloud tab, and of the large picture above the scene."""

    page: Page
    tab: viser.GuiTabHandle
    mark: Callable[..., None]
    """mark(camera, client, marked): hand over the next box dragged over a camera's image"""
    card: CloudCard | None = None
    cloud: CloudSnapshot | None = None
    large: viser.PanelHandle | None = None
    built: bool = False
    large_image: viser.GuiImageHandle | None = None
    widgets: dict[str, Any] = field(default_factory=dict)

    def fit(self, card: CloudCard) -> None:
        """Build the tab once, then show the settings in force."""
        self.card = card
        if not self.built:
            self.built = True
            with self.tab:
                self._build(card)
        else:
            for controls in (self.filters, self.skin, self.stereo):
                controls.fit(card)
        for folder in (self.scene, *self.filters.folders, self.skin.folder):
            if folder is not None and folder.visible != bool(card.source):
                folder.visible = bool(card.source)
        if not card.source:
            self.counts.content = ""
        self._offer_pictures(card)
        self._say_saved()
        self.note.content = _note(card)

    def _build(self, card: CloudCard) -> None:
        page, gui, display = self.page, self.page.gui, self.page.state.display
        blank = np.full((8, 8, 3), 36, np.uint8)
        self.picture = gui.add_image(blank, format="jpeg", jpeg_quality=85, visible=False)
        self.said = gui.add_html("")
        self.counts = gui.add_html("")
        self.note = gui.add_html(_note(card))
        picture = gui.add_dropdown(
            "Picture", tuple(_PICTURES),
            hint="Cameras: each point in the colour of the filter that dropped it; yellow ones stay.",
        )  # fmt: skip
        wide = gui.add_checkbox("Large", display.cloud_wide, hint="Over the scene.")
        self.scene = gui.add_folder("In the scene")
        with self.scene:
            on = gui.add_checkbox("Cloud", display.cloud)
            colour = gui.add_dropdown(
                "Colour", tuple(_COLOURS), initial_value=next(iter(_COLOURS)),
                hint="Distance to the model: blue inside, grey on its surface, orange outside.",
            )  # fmt: skip
            size = gui.add_slider("Point mm", 0.4, 6.0, 0.2, display.cloud_size_mm)
            dropped = gui.add_checkbox(
                "Dropped", display.cloud_dropped, hint="Grey: what the filters dropped."
            )
            self.legend = gui.add_html(ramp_legend())
        self.filters = FilterControls(page, self.set)
        self.skin = SkinControls(page, self.set, self._mark)
        self.stereo = StereoControls(page, self.set)
        for controls in (self.filters, self.skin, self.stereo):
            controls.fit(card)
        self.saved = gui.add_html("")
        save = gui.add_button(
            "Save to session.toml", icon=viser.Icon.DEVICE_FLOPPY, color="gray",
            hint="Only the table [clouds] changes; the file before is kept in versions/.",
        )  # fmt: skip
        back = gui.add_button(
            "Back to session.toml", icon=viser.Icon.RESTORE, color="gray",
            hint="Forget what was changed here since.",
        )  # fmt: skip
        page.on(picture, lambda e: self._show("cloud_picture", _PICTURES.get(e.value)))
        page.on(wide, lambda e: self._show("cloud_wide", bool(e.value)))
        page.on(on, lambda e: self._show("cloud", bool(e.value)))
        page.on(colour, lambda e: self._show("cloud_colour", _COLOURS.get(e.value)))
        page.on(dropped, lambda e: self._show("cloud_dropped", bool(e.value)))
        page.on(size, lambda e: self._show("cloud_size_mm", number(e.value, 0.4, 6.0)))
        page.on(save, lambda _: page.engine.save_clouds())
        page.on(back, lambda _: page.engine.restore_clouds())
        self.widgets = {
            "picture": picture, "wide": wide, "on": on, "colour": colour, "size": size, "dropped": dropped,
            "save": save, "back": back,
        }  # fmt: skip

    def set(self, **values: object) -> None:
        """Change settings of [clouds]."""
        self.page.engine.set_clouds(values)

    def _mark(self, camera: str, client: viser.ClientHandle, marked: Callable[..., None]) -> None:
        """Have a box dragged over a camera's image; the large picture would stand before it."""
        self._show("cloud_wide", False)
        self.widgets["wide"].value = False
        self.mark(camera, client, marked)

    def _offer_pictures(self, card: CloudCard) -> None:
        """Offer the pictures that there are."""
        some = {"images": bool(card.source), "stereo": bool(card.pairs), "none": True}
        words = {w: p for w, p in _PICTURES.items() if some[p]}
        wished = self.page.state.display.cloud_picture
        shown = next((w for w, p in words.items() if p == wished), "none")
        picture = self.widgets["picture"]
        put(picture, options=tuple(words))
        put(picture, value=shown)
        picture.visible = self.widgets["wide"].visible = len(words) > 1

    def _show(self, name: str, value: object) -> None:
        if value is None:
            return
        self.page.draw(name, value)
        self.legend.visible = self.page.state.display.cloud_colour == "residual"
        self._place_picture()

    # ---- snapshots

    def show(self, cloud: CloudSnapshot) -> None:
        """Say what the filters did to a frame's cloud."""
        self.cloud = cloud
        if self.built:
            self.counts.content = counts_table(cloud)
            self.legend.content = ramp_legend(cloud)

    def show_picture(self, picture: CloudPicture) -> None:
        """Show the pictures of a frame's cloud."""
        if not self.built:
            return
        if picture.wide:
            self._large().image = picture.image
        else:
            self.picture.image = picture.image
        self.said.content = _small(picture.words)
        self._place_picture()

    def _large(self) -> viser.GuiImageHandle:
        if self.large_image is None:
            gui = self.page.gui
            self.large = gui.add_panel()
            with self.large.add_tab("Picture"):
                gui.add_html("<div class='handtrack-picture'></div>")
                blank = np.full((8, 8, 3), 36, np.uint8)
                self.large_image = gui.add_image(blank, format="jpeg", jpeg_quality=85)
            self.large.float(x=16, y=16, width=560)
        return self.large_image

    def _place_picture(self) -> None:
        display = self.page.state.display
        some = display.cloud_picture != "none"
        self.picture.visible = some and not display.cloud_wide
        if self.large is not None:
            self.large.visible = some and display.cloud_wide

    def _say_saved(self) -> None:
        changed = self.card.unsaved if self.card is not None else ()
        text = f"Not in session.toml yet: {', '.join(changed)}." if changed else ""
        self.saved.content = _small(text)
        for name in ("save", "back"):
            self.widgets[name].visible = bool(changed)


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
    return _small(text)


def _small(text: str) -> str:
    if not text:
        return ""
    return f"<div style='padding:.3em .9em;font-size:.85em;line-height:1.4;opacity:.8'>{html.escape(text)}</div>"


def counts_table(cloud: CloudSnapshot) -> str:
    """Return how many points each filter got and left, as bars."""
    most = max(cloud.measured, 1)
    rows = [_row("measured", "all points of this frame", None, cloud.measured, most, "")]
    for count in cloud.counts:
        colour = FILTERS.get(count.name, FILTERS["range"])
        word = _FILTER_WORDS.get(count.name, count.name)
        rows.append(_row(word, count.text, colour, count.after, most, _lost(count)))
    rows.append(_row("for the tracker", "what is left", KEPT, cloud.left, most, ""))
    said = (
        f"<div style='margin-top:.3em;opacity:.8'>{html.escape(cloud.words)}</div>"
        if cloud.words
        else ""
    )
    return (
        f"<div style='padding:.4em .9em;font-size:.8em;line-height:1.45'><b>Cloud of frame {cloud.frame}</b>"
        f"<table style='width:100%;border-spacing:0 1px;border-collapse:separate'>{''.join(rows)}</table>{said}</div>"
    )


def _lost(count: FilterCount) -> str:
    lost = count.before - count.after
    return f"−{_grouped(lost)}" if lost else ""


def _row(
    word: str, text: str, colour: tuple[int, int, int] | None, after: int, most: int, lost: str
) -> str:
    dot = ""
    if colour is not None:
        dot = (
            f"<span style='display:inline-block;width:.7em;height:.7em;border-radius:2px;margin-right:.4em;"
            f"background:rgb{colour}'></span>"
        )
    share = 100 * after / most
    return (
        f"<tr title='{html.escape(text)}'><td style='white-space:nowrap;padding-right:.5em'>{dot}{html.escape(word)}</td>"
        f"<td style='width:34%'><div style='height:.5em;border-radius:2px;background:rgba(128,128,128,.22)'>"
        f"<div style='height:.5em;border-radius:2px;background:#56b4e9;width:{share:.1f}%'></div></div></td>"
        f"<td style='text-align:right;white-space:nowrap;opacity:.65;padding-left:.4em'>{lost}</td>"
        f"<td style='text-align:right;white-space:nowrap;padding-left:.5em'>{_grouped(after)}</td></tr>"
    )


def _grouped(count: int) -> str:
    return f"{count:,}".replace(",", "\u202f")


def ramp_legend(cloud: CloudSnapshot | None = None) -> str:
    """Return what the colours of distances mean [mm], and how far the points are in the middle."""
    steps = np.linspace(-RESIDUAL_MM, RESIDUAL_MM, 9)
    stops = ",".join(f"rgb{tuple(int(v) for v in c)}" for c in residual_colours(steps))
    said = ""
    if cloud is not None and np.isfinite(cloud.residual_mm).any():
        off = np.abs(cloud.residual_mm[np.isfinite(cloud.residual_mm)])
        middle, most = np.quantile(off, [0.5, 0.9])
        said = (
            f"<div style='opacity:.8'>half within {middle:.1f} mm, 90 % within {most:.1f} mm</div>"
        )
    return (
        "<div style='padding:.3em .9em .4em;font-size:.8em;line-height:1.4'>"
        f"<div style='height:.7em;border-radius:3px;background:linear-gradient(90deg,{stops})'></div>"
        "<div style='display:flex;justify-content:space-between;opacity:.8'>"
        f"<span>−{RESIDUAL_MM:.0f} mm inside</span><span>0</span><span>outside +{RESIDUAL_MM:.0f} mm</span></div>"
        f"{said}</div>"
    )
