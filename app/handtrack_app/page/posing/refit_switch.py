"""The switch of refitting while tuning, on each tab whose widgets change what a frame is fitted by."""

from __future__ import annotations

from dataclasses import dataclass, field

import viser

from handtrack_app.page.page import Keys, Page, put

_HINT = (
    "Each change of a setting, limit or filter fits the frame shown anew at once, from where it stands; the card says what that did "
    "to energy and overlap. Ctrl-Z takes the change and its fit back together; Tab shows the pose before."
)


@dataclass
class RefitSwitch:
    """Handles of the switch; they show one state."""

    page: Page
    keys: Keys
    on: bool = False
    boxes: list[viser.GuiCheckboxHandle] = field(default_factory=list)

    def __post_init__(self) -> None:
        act = self.page.from_user(lambda _: self.turn(not self.on))
        self.keys.add("Refit while tuning: on, off", "R", act, "alt")

    def build(self) -> None:
        """Add a switch where the page builds now."""
        box = self.page.gui.add_checkbox("Refit as I tune", self.on, hint=_HINT)
        self.page.on(box, lambda event: self.turn(bool(event.value)))
        self.boxes.append(box)

    def turn(self, on: bool) -> None:
        """Turn it on or off."""
        self.on = on
        for box in self.boxes:
            put(box, value=on)
        self.page.engine.refit_while_tuning(on)
