"""A small web server with one widget of each kind."""

from types import SimpleNamespace

import pytest

from handtrack_app.access.web_server import start_web_server


@pytest.fixture
def small():
    """The web server and its widgets; heard: values as callbacks got them."""
    web, heard = start_web_server(), []
    gui = web.server.gui
    page = SimpleNamespace(
        web=web,
        url=web.url,
        heard=heard,
        slider=gui.add_slider("Slider", 0.0, 10.0, 0.5, 1.0),
        whole=gui.add_slider("Whole", 0, 10, 1, 1),
        span=gui.add_multi_slider("Span", 0, 10, 1, (2, 8)),
        button=gui.add_button("Button"),
        row=gui.add_button_group("Row", ("Left", "Right")),
        choice=gui.add_dropdown("Choice", ("One", "Two")),
        box=gui.add_checkbox("Box", False),
        control=web.server.scene.add_transform_controls("/control"),
    )
    for widget in (page.slider, page.whole, page.span, page.choice, page.box):
        widget.on_update(lambda event: heard.append(event.target.value))
    page.button.on_click(lambda _: heard.append("clicked"))
    page.row.on_click(lambda event: heard.append(event.target.value))
    yield page
    web.server.stop()
