"""A small server behind the door, with one widget of each kind."""

from types import SimpleNamespace

import pytest

from handtrack_app.door.access import open_door


@pytest.fixture
def small():
    """The door, and what stands behind it; heard: values as callbacks got them."""
    door, heard = open_door(), []
    gui = door.server.gui
    page = SimpleNamespace(
        door=door,
        url=door.url,
        heard=heard,
        slider=gui.add_slider("Slider", 0.0, 10.0, 0.5, 1.0),
        whole=gui.add_slider("Whole", 0, 10, 1, 1),
        span=gui.add_multi_slider("Span", 0, 10, 1, (2, 8)),
        button=gui.add_button("Button"),
        row=gui.add_button_group("Row", ("Left", "Right")),
        choice=gui.add_dropdown("Choice", ("One", "Two")),
        box=gui.add_checkbox("Box", False),
        control=door.server.scene.add_transform_controls("/control"),
    )
    for widget in (page.slider, page.whole, page.span, page.choice, page.box):
        widget.on_update(lambda event: heard.append(event.target.value))
    page.button.on_click(lambda _: heard.append("clicked"))
    page.row.on_click(lambda event: heard.append(event.target.value))
    yield page
    door.server.stop()
