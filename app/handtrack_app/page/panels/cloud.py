"""Clouds: the frame's pictures first, what each filter dropped, how the cloud is drawn, and saving the settings."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import viser

from handtrack.capture.clouds.skin_ellipse import SkinEllipse
from handtrack.session.clouds_settings import CLOUD_SETTINGS
from handtrack.setting import Setting
from handtrack_app.page.page import Page, UserEvent, clean_interval, number, put
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


# ---- Sliders of the clouds' filters and of stereo matching; 0 switches a filter off


Set = Callable[..., None]
"""set(name=value, ...): change settings of [clouds]"""


@dataclass(frozen=True)
class FilterSlider:
    """How one number of [clouds] is drawn."""

    known: Setting

    @property
    def name(self) -> str:
        return self.known.name

    @property
    def hint(self) -> str:
        return f"{self.known.help} 0: off." if self.span[0] == 0 else self.known.help

    @property
    def span(self) -> tuple[float, float, float]:
        """Low, high and step on the page."""
        assert self.known.slider is not None, f"{self.name} has no slider"
        return self.known.slider

    def on_page(self, value: object) -> float:
        """Return where the slider stands for a setting; off is 0."""
        if not isinstance(value, int | float) or isinstance(value, bool):
            return self.span[0]
        shown = min(max(value / self.known.page_unit, self.span[0]), self.span[1])
        return round(shown) if self.known.kind is int else round(shown, 4)

    def in_file(self, shown: float) -> float | int | bool:
        """Return the setting for a slider's value; False at 0."""
        if shown <= 0:
            return False
        if self.known.kind is float:
            return round(shown * self.known.page_unit, 6)
        odd = self.span[2] == 2
        return 2 * int(shown // 2) + 1 if odd else round(shown)


def _sliders(*names: str) -> tuple[FilterSlider, ...]:
    return tuple(FilterSlider(CLOUD_SETTINGS[name]) for name in names)


CROP = _sliders("near_m", "far_m", "crop_m", "front_m")
THIN = _sliders("voxel_m", "per_voxel", "outlier_neighbours", "outlier_ratio", "max_points")
STEREO = _sliders(
    "stereo_window_px", "stereo_left_right_px", "stereo_contrast", "stereo_speckle_px"
)
_PARTS = {word: value for value, word in CLOUD_SETTINGS["component"].words.items()}
_METHODS = {word: value for value, word in CLOUD_SETTINGS["stereo_method"].words.items()}


@dataclass
class Sliders:
    """Sliders for numbers of [clouds]."""

    page: Page
    set: Set
    known: dict[str, tuple[FilterSlider, viser.GuiSliderHandle[float]]] = field(
        default_factory=dict
    )

    def add(self, slider: FilterSlider) -> None:
        """Add a slider where the page builds now."""
        low, high, step = slider.span
        widget = self.page.gui.add_slider(
            slider.known.label, low, high, step, low, hint=slider.hint
        )
        self.page.on(widget, lambda event: self._changed(slider, event.value))
        self.known[slider.name] = (slider, widget)

    def fit(self, card: CloudCard) -> None:
        """Show the settings in force."""
        for name, (slider, widget) in self.known.items():
            shown = slider.on_page(card.values.get(name))
            put(widget, value=shown)

    def _changed(self, slider: FilterSlider, value: object) -> None:
        shown = number(value, *slider.span[:2])
        if shown is not None:
            self.set(**{slider.name: slider.in_file(shown)})


class FilterControls:
    """Crop and part in one folder, thinning and outliers in another."""

    def __init__(self, page: Page, set_: Set) -> None:
        gui = page.gui
        self.sliders = Sliders(page, set_)
        crop = gui.add_folder("Crop")
        thin = gui.add_folder("Thin, and drop outliers", expand_by_default=False)
        self.folders = (crop, thin)
        with crop:
            for slider in CROP[:3]:
                self.sliders.add(slider)
            self.part = gui.add_dropdown(
                "Part",
                tuple(_PARTS),
                hint=CLOUD_SETTINGS["component"].help,
            )
            self.sliders.add(CROP[3])
        with thin:
            for slider in THIN:
                self.sliders.add(slider)
        page.on(self.part, lambda e: set_(component=_PARTS.get(e.value, "all")))

    def fit(self, card: CloudCard) -> None:
        """Show the settings in force."""
        self.sliders.fit(card)
        shown = next((w for w, own in _PARTS.items() if own == card.values.get("component")), "all")
        put(self.part, value=shown)
        self.sliders.known["front_m"][1].disabled = card.values.get("component") != "nearest"


class StereoControls:
    """The pair that is looked at, and how it is matched."""

    def __init__(self, page: Page, set_: Set) -> None:
        self.page, self.set = page, set_
        self.card: CloudCard | None = None
        self.folder: viser.GuiFolderHandle | None = None

    def _build(self, card: CloudCard) -> None:
        page, gui = self.page, self.page.gui
        self.sliders = Sliders(page, self.set)
        self.folder = gui.add_folder("Stereo", expand_by_default=not card.source)
        with self.folder:
            pairs = tuple(" – ".join(pair) for pair in card.pairs)
            first = " – ".join(card.pair or card.pairs[0])
            self.pair = gui.add_dropdown("Pair", pairs, initial_value=first)
            self.method = gui.add_dropdown("Method", tuple(_METHODS))
            for slider in STEREO:
                self.sliders.add(slider)
            self.take = gui.add_button(
                "Clouds from this pair", icon=viser.Icon.ARROW_MERGE, color="gray", visible=False,
                hint="The session's clouds come from this pair from now on.",
            )  # fmt: skip
        page.on(self.pair, lambda event: self._choose(event.value))
        page.on(self.method, lambda e: self.set(stereo_method=_METHODS.get(e.value, "sgbm")))
        page.on(self.take, lambda _: self._take())

    def chosen(self) -> tuple[str, str] | None:
        """Return the pair that is looked at."""
        chosen = self.page.state.display.stereo_pair
        return chosen if chosen is not None or self.card is None else self.card.pair

    def _choose(self, words: object) -> None:
        pairs = {" – ".join(pair): pair for pair in (self.card.pairs if self.card else ())}
        if words in pairs:
            self.page.state.display.stereo_pair = pairs[str(words)]
            self._offer()
            self.page.redraw()

    def _take(self) -> None:
        pair = self.chosen()
        if pair is not None:
            self.set(stereo=(pair,))

    def _offer(self) -> None:
        card = self.card
        used = card is not None and card.source == "stereo" and self.chosen() == card.pair
        self.take.visible = not used

    def fit(self, card: CloudCard) -> None:
        """Show the settings in force; without two cameras there is nothing to match."""
        self.card = card
        if not card.pairs:
            return
        if self.folder is None:
            self._build(card)
        self.sliders.fit(card)
        shown = next(
            (w for w, own in _METHODS.items() if own == card.values["stereo_method"]), None
        )
        if shown is not None and self.method.value != shown:
            self.method.value = shown
        self._offer()


# ---- Skin colour: an ellipse in (r, g) fitted to a box on an image, with its size as the threshold


Box = tuple[int, int, int, int]
_SIZE = (0.5, 10.0, 0.1)
_LATER = "no box marked yet"


class SkinControls:
    """Where the colour is taken from, and how far from it counts."""

    def __init__(
        self,
        page: Page,
        set_: Callable[..., None],
        mark: Callable[..., None],
    ) -> None:
        self.page, self.set, self.mark = page, set_, mark
        self.card: CloudCard | None = None
        self.folder: viser.GuiFolderHandle | None = None

    def _build(self, card: CloudCard) -> None:
        page, gui = self.page, self.page.gui
        self.folder = gui.add_folder("Skin colour", expand_by_default=False)
        with self.folder:
            self.words = gui.add_html("")
            self.on = gui.add_checkbox(
                "Skin only", False, hint="Drop points of other colours; take the colour first."
            )
            self.size = gui.add_slider(
                "Ellipse's size", *_SIZE, 2.5,
                hint="The threshold, in standard deviations of the samples' (r, g).",
            )  # fmt: skip
            self.camera = gui.add_dropdown("Box in", card.image_cameras)
            drag = gui.add_button(
                "Drag a box over the image", icon=viser.Icon.MARQUEE_2, color="gray",
                hint="Looks through the camera; drag over skin, away from its edges.",
            )  # fmt: skip
            width, height = card.sizes[card.image_cameras[0]]
            self.across = gui.add_multi_slider(
                "Box x px", 0, width, 1, initial_value=(width // 3, width // 2), min_range=2
            )
            self.down = gui.add_multi_slider(
                "Box y px", 0, height, 1, initial_value=(height // 3, height // 2), min_range=2
            )
            take = gui.add_button(
                "Take the colour in the box", icon=viser.Icon.COLOR_PICKER, color="gray"
            )
            painted = gui.add_button(
                "Take it from painted masks", icon=viser.Icon.BRUSH, color="gray",
                hint="Of all cameras and frames in which you painted what is tracked, in the tab Masks.",
            )  # fmt: skip
        page.on(painted, lambda _: self._take_painted())
        page.on(self.on, lambda event: self._switch(bool(event.value)))
        page.on(self.size, lambda event: self._resize(event.value))
        page.on(self.camera, lambda _: self._camera_chosen())
        for slider in (self.across, self.down):
            page.on(slider, lambda _: self._show_box(self.box()))
        page.on(drag, self._drag)
        page.on(take, lambda _: self._take(self.box()))
        self.drag, self.take = drag, take

    @property
    def ellipse(self) -> SkinEllipse | None:
        """The ellipse in force."""
        skin = None if self.card is None else self.card.values.get("skin")
        return skin if isinstance(skin, SkinEllipse) else None

    def box(self) -> Box | None:
        """Return the box that the sliders mark; None where they hold no numbers."""
        pairs = [clean_interval(s.value, s.min, s.max) for s in (self.across, self.down)]
        if pairs[0] is None or pairs[1] is None:
            return None
        (left, right), (top, bottom) = pairs[0], pairs[1]
        return int(left), int(top), int(right - left), int(bottom - top)

    def _camera_chosen(self) -> None:
        size = self.card.sizes.get(str(self.camera.value)) if self.card is not None else None
        if size is not None:
            self.across.max, self.down.max = size
            self._show_box(self.box())

    def _switch(self, on: bool) -> None:
        if not on:
            self.kept = self.ellipse or getattr(self, "kept", None)
            self.set(skin=None)
        elif getattr(self, "kept", None) is not None:
            self.set(skin=self.kept)
        else:
            self._take(self.box())

    def _resize(self, value: object) -> None:
        size = number(value, *_SIZE[:2])
        if size is not None and self.ellipse is not None:
            self.set(skin=replace(self.ellipse, size=round(size, 3)))

    def _show_box(self, box: Box | None) -> None:
        if box is not None:
            self.page.state.display.skin_box = (str(self.camera.value), box)
            self.page.redraw()

    def _drag(self, event: UserEvent) -> None:
        def marked(box: Box) -> None:
            self.across.value = (box[0], box[0] + box[2])
            self.down.value = (box[1], box[1] + box[3])
            self._show_box(box)
            self._take(box)

        if event.client is not None:
            self.mark(str(self.camera.value), event.client, marked)
            self.page.notify(
                "info",
                "Drag a box",
                "Press the mouse over skin in the image and drag. The model is hidden until then; key 0 looks freely again.",
                event.client,
            )

    def _take(self, box: Box | None) -> None:
        if box is not None:
            self._show_box(box)
            self._send(box)

    def _take_painted(self) -> None:
        self._send(None)

    def _send(self, box: Box | None) -> None:
        size = number(self.size.value, *_SIZE[:2]) or 2.5
        self.page.engine.sample_skin(self.page.state.frame, str(self.camera.value), box, size)

    def fit(self, card: CloudCard) -> None:
        """Show the ellipse in force; without images there is no colour."""
        self.card = card
        if not card.image_cameras:
            return
        if self.folder is None:
            self._build(card)
        skin = self.ellipse
        put(self.on, value=skin is not None)
        if skin is not None and abs(self.size.value - skin.size) > 1e-9:
            self.size.value = min(max(skin.size, _SIZE[0]), _SIZE[1])
        self.words.content = _ellipse_picture(skin)


def _ellipse_picture(skin: SkinEllipse | None) -> str:
    text = _LATER if skin is None else f"r {skin.mean[0]:.3f}, g {skin.mean[1]:.3f}"
    return (
        "<div style='padding:.2em .9em;font-size:.8em;line-height:1.4;opacity:.85'>"
        f"Colour of skin: {html.escape(text)}</div>"
    )
