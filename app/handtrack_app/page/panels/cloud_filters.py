"""Sliders of the clouds' filters and of stereo matching; 0 switches a filter off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import viser

from handtrack.session.clouds_settings import CLOUD_SETTINGS
from handtrack.setting import Setting
from handtrack_app.page.page import Page, number, put
from handtrack_app.protocol.snapshots import CloudCard

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
