"""A small server behind the door, with one widget of each kind."""

from dataclasses import dataclass

import pytest
import viser

from handtrack_app.door.access import Door, open_door


@dataclass(frozen=True)
class SmallPage:
    """The door, and what stands behind it."""

    door: Door
    slider: viser.GuiSliderHandle
    whole: viser.GuiSliderHandle
    span: viser.GuiMultiSliderHandle
    button: viser.GuiButtonHandle
    row: viser.GuiButtonGroupHandle
    choice: viser.GuiDropdownHandle
    box: viser.GuiCheckboxHandle
    control: viser.TransformControlsHandle
    heard: list[object]
    """values as callbacks got them"""

    @property
    def url(self) -> str:
        return self.door.url


@pytest.fixture
def small():
    door = open_door()
    gui, heard = door.server.gui, []
    page = SmallPage(
        door,
        gui.add_slider("Slider", 0.0, 10.0, 0.5, 1.0),
        gui.add_slider("Whole", 0, 10, 1, 1),
        gui.add_multi_slider("Span", 0, 10, 1, (2, 8)),
        gui.add_button("Button"),
        gui.add_button_group("Row", ("Left", "Right")),
        gui.add_dropdown("Choice", ("One", "Two")),
        gui.add_checkbox("Box", False),
        door.server.scene.add_transform_controls("/control"),
        heard,
    )
    for widget in (page.slider, page.whole, page.span, page.choice, page.box):
        widget.on_update(lambda event: heard.append(event.target.value))
    page.button.on_click(lambda _: heard.append("clicked"))
    page.row.on_click(lambda event: heard.append(event.target.value))
    yield page
    door.server.stop()
