"""Sliders of the clouds' filters and of stereo matching; 0 switches a filter off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import viser

from handtrack_app.page.page import Page, number, put
from handtrack_app.protocol.snapshots import CloudCard

Set = Callable[..., None]
"""set(name=value, ...): change settings of [clouds]"""


@dataclass(frozen=True)
class FilterKnob:
    """How one number of [clouds] is drawn."""

    name: str
    label: str
    hint: str
    span: tuple[float, float, float]
    """low, high, step on the page"""
    unit: float = 1.0
    """what 1 on the page is in session.toml"""
    whole: bool = False
    odd: bool = False

    def on_page(self, value: object) -> float:
        """Return where the slider stands for a setting; off is 0."""
        if not isinstance(value, int | float) or isinstance(value, bool):
            return self.span[0]
        shown = min(max(value / self.unit, self.span[0]), self.span[1])
        return round(shown) if self.whole else round(shown, 4)

    def in_file(self, shown: float) -> float | int | bool:
        """Return the setting for a slider's value; False at 0."""
        if shown <= 0:
            return False
        if self.odd:
            return 2 * int(shown // 2) + 1
        return round(shown) if self.whole else round(shown * self.unit, 6)


CROP = (
    FilterKnob("near_m", "Nearest cm", "Points nearer to every camera are dropped; 0: none.", (0, 100, 1), 0.01),
    FilterKnob("far_m", "Farthest cm", "Points farther from every camera are dropped; 0: none.", (0, 400, 5), 0.01),
    FilterKnob("crop_m", "To hand mm", "Largest distance to the hand of the frame before; 0: any.",
               (0, 300, 5), 0.001),
    FilterKnob("front_m", "Deep mm", "Of the nearest part, how far behind its front end it may reach; 0: any.",
               (0, 500, 5), 0.001),
)  # fmt: skip
THIN = (
    FilterKnob("voxel_m", "Cell mm", "Side of the cells in which points are thinned; 0: no thinning.",
               (0, 15, 0.25), 0.001),
    FilterKnob("per_voxel", "Points a cell", "Points that stay in each cell.", (1, 20, 1), whole=True),
    FilterKnob("outlier_neighbours", "Neighbours", "Points whose neighbours are far are outliers; 0: none are.",
               (0, 40, 1), whole=True),
    FilterKnob("outlier_ratio", "Outlier ×", "Times the usual distance to the neighbours.", (1.0, 8.0, 0.1)),
    FilterKnob("max_points", "At most", "A random part of this many points stays; 0: all.", (0, 20000, 250),
               whole=True),
)  # fmt: skip
STEREO = (
    FilterKnob("stereo_window_px", "Window px", "Side of the squares that are compared; odd.", (3, 31, 2), whole=True,
               odd=True),
    FilterKnob("stereo_left_right_px", "Left-right px", "How far the matches both ways may differ.", (0.25, 6, 0.25)),
    FilterKnob("stereo_contrast", "Contrast", "Grey levels around a pixel below which nothing is matched.",
               (0.1, 12, 0.1)),
    FilterKnob("stereo_speckle_px", "Speckle px", "Smaller patches that stand off are dropped.", (1, 600, 1),
               whole=True),
)  # fmt: skip
_PARTS = {"all": "all", "nearest to a camera": "nearest", "largest": "largest"}
_METHODS = {"semi-global (SGBM)": "sgbm", "correlation (2004)": "correlation"}


@dataclass
class Sliders:
    """Sliders for numbers of [clouds]."""

    page: Page
    set: Set
    known: dict[str, tuple[FilterKnob, viser.GuiSliderHandle[float]]] = field(default_factory=dict)

    def add(self, knob: FilterKnob) -> None:
        """Add a slider where the page builds now."""
        low, high, step = knob.span
        widget = self.page.gui.add_slider(knob.label, low, high, step, low, hint=knob.hint)
        self.page.on(widget, lambda event: self._changed(knob, event.target))
        self.known[knob.name] = (knob, widget)

    def fit(self, card: CloudCard) -> None:
        """Show the settings in force."""
        for name, (knob, widget) in self.known.items():
            shown = knob.on_page(card.values.get(name))
            put(widget, value=shown)

    def _changed(self, knob: FilterKnob, widget: viser.GuiSliderHandle[float]) -> None:
        shown = number(widget.value, *knob.span[:2])
        if shown is not None:
            self.set(**{knob.name: knob.in_file(shown)})


class FilterKnobs:
    """Crop and part in one folder, thinning and outliers in another."""

    def __init__(self, page: Page, set_: Set) -> None:
        gui = page.gui
        self.sliders = Sliders(page, set_)
        crop = gui.add_folder("Crop")
        thin = gui.add_folder("Thin, and drop outliers", expand_by_default=False)
        self.folders = (crop, thin)
        with crop:
            for knob in CROP[:3]:
                self.sliders.add(knob)
            self.part = gui.add_dropdown(
                "Part",
                tuple(_PARTS),
                hint="Of the parts that hang together, which one is the hand.",
            )
            self.sliders.add(CROP[3])
        with thin:
            for knob in THIN:
                self.sliders.add(knob)
        page.on(self.part, lambda e: set_(component=_PARTS.get(e.target.value, "all")))

    def fit(self, card: CloudCard) -> None:
        """Show the settings in force."""
        self.sliders.fit(card)
        shown = next((w for w, own in _PARTS.items() if own == card.values.get("component")), "all")
        put(self.part, value=shown)
        self.sliders.known["front_m"][1].disabled = card.values.get("component") != "nearest"


class StereoKnobs:
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
            for knob in STEREO:
                self.sliders.add(knob)
            self.take = gui.add_button(
                "Clouds from this pair", icon=viser.Icon.ARROW_MERGE, color="gray", visible=False,
                hint="The session's clouds come from this pair from now on.",
            )  # fmt: skip
        page.on(self.pair, lambda event: self._choose(event.target.value))
        page.on(self.method, lambda e: self.set(stereo_method=_METHODS.get(e.target.value, "sgbm")))
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
