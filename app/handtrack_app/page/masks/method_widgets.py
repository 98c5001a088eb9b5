"""Widgets of the mask methods' settings: a folder for each method, of which the one in force shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import viser

from handtrack_app.page.page import Page, number, put

METHOD_WORDS = {
    "seeded": "seeded by joints",
    "skin_ycrcb": "skin, fixed colours",
    "skin_adaptive": "skin, colour of a box",
    "background_median": "before the usual image",
    "background_mog2": "before a changing background",
    "depth_range": "range of depth",
    "files": "files of the session",
    "none": "none",
}
_Widget = viser.GuiCheckboxHandle | viser.GuiSliderHandle[float] | viser.GuiMultiSliderHandle[float]
Set = Callable[[str, object], None]
"""set(name, value): change a setting of the method"""


@dataclass(frozen=True)
class Field:
    """How a setting of a method is drawn: a slider; of two numbers where `pair`; a checkbox where `high` is 0."""

    label: str
    hint: str
    low: float = 0
    high: float = 0
    step: float = 1
    pair: bool = False


_OPEN = Field("Opening px", "Side of the square whose opening removes specks; 0: none.", 0, 25)
_LARGEST = Field("Largest piece", "Other pieces are background.")
_BRIGHT = Field("Brighter than", "Darker pixels are background.", 0, 255)
_SAMPLES = Field("Learned from", "So many frames, evenly spaced over the recording.", 3, 100)
FIELDS: dict[str, dict[str, Field]] = {
    "seeded": {
        "sure": Field("How sure", "Probability below which a pixel is unknown.", 0.55, 0.99, 0.01),
        "samples": _SAMPLES,
    },
    "skin_ycrcb": {
        "cr": Field("Cr (red)", "Range of skin's red difference.", 0, 255, 1, True),
        "cb": Field("Cb (blue)", "Range of skin's blue difference.", 0, 255, 1, True),
        "y_min": _BRIGHT, "open_px": _OPEN, "largest": _LARGEST,
    },
    "skin_adaptive": {
        "size": Field("Ellipse's size", "In standard deviations of the box's colours.", 0.5, 8, 0.1),
        "y_min": _BRIGHT, "open_px": _OPEN, "largest": _LARGEST,
    },
    "background_median": {
        "threshold": Field("Difference", "In the pixel's own standard deviations.", 1, 40, 0.5),
        "samples": _SAMPLES, "open_px": _OPEN, "largest": _LARGEST,
    },
    "background_mog2": {
        "threshold": Field("Difference", "Squared, in variances.", 1, 100, 1),
        "shadows": Field("No shadows", "Darkened background counts as such."),
        "samples": _SAMPLES, "open_px": _OPEN, "largest": _LARGEST,
    },
    "depth_range": {
        "near_m": Field("Nearest m", "Nearer is background.", 0.05, 3, 0.01),
        "far_m": Field("Farthest m", "Farther is background.", 0.05, 3, 0.01),
        "open_px": _OPEN, "largest": _LARGEST,
    },
}  # fmt: skip
"""by method and setting"""


class MethodWidgets:
    """The settings of one method."""

    def __init__(self, page: Page, method: str, set_: Set) -> None:
        gui = page.gui
        self.folder: viser.GuiFolderHandle = gui.add_folder(METHOD_WORDS[method], visible=False)
        self._widgets: dict[str, _Widget] = {}
        with self.folder:
            for name, drawn in FIELDS[method].items():
                widget = _widget(gui, drawn)
                self._widgets[name] = widget
                page.on(
                    widget,
                    lambda event, name=name, drawn=drawn: _send(set_, name, drawn, event.value),
                )
        self._fields = FIELDS[method]

    def fit(self, values: Mapping[str, object]) -> None:
        """Show the settings in force."""
        for name, widget in self._widgets.items():
            if name in values:
                put(widget, value=_shown(self._fields[name], values[name]))


def _widget(gui: viser.GuiApi, drawn: Field) -> _Widget:
    if not drawn.high:
        return gui.add_checkbox(drawn.label, False, hint=drawn.hint)
    span = drawn.low, drawn.high, drawn.step
    if drawn.pair:
        ends = drawn.low, drawn.high
        return gui.add_multi_slider(
            drawn.label, *span, initial_value=ends, min_range=drawn.step, hint=drawn.hint
        )
    return gui.add_slider(drawn.label, *span, drawn.low, hint=drawn.hint)


def _shown(drawn: Field, value: object) -> bool | float | tuple[float, ...]:
    if not drawn.high:
        return bool(value)
    if isinstance(value, list | tuple):
        return tuple(int(part) for part in value)
    inside = number(value, drawn.low, drawn.high)
    assert inside is not None, "settings in force are numbers"
    return round(inside) if isinstance(drawn.step, int) else inside


def _send(set_: Set, name: str, drawn: Field, value: object) -> None:
    if not drawn.high:
        set_(name, bool(value))
        return
    parts = [
        number(part, drawn.low, drawn.high)
        for part in (value if isinstance(value, list | tuple) else (value,))
    ]
    if any(part is None for part in parts):
        return
    whole = [
        round(part) if isinstance(drawn.step, int) else round(part, 4)
        for part in parts
        if part is not None
    ]
    if drawn.pair:
        set_(name, tuple(sorted(whole)))
    else:
        set_(name, float(whole[0]) if name == "threshold" else whole[0])
