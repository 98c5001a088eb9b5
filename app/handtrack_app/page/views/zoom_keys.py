"""What a user does with a view through a camera: keys and buttons; and a line that says how the picture is seen."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass, field

import viser

from handtrack_app.page.page import Keys, Page, put
from handtrack_app.page.views.through import Through, Views
from handtrack_app.page.views.wall import Walls

_STEP = 1.4  # two of them twice as large
_HINT = (
    "Looking through a camera: Z and X, or the wheel, enlarge and widen; Ctrl with a click enlarges what is there, Ctrl with a drag "
    "the box; a drag of the picture moves it. C is the {kind} again, V the whole image."
)


@dataclass
class ZoomKeys:
    """Keys and buttons of the views; each page's own line about its view."""

    page: Page
    views: Views
    walls: Walls
    keys: Keys
    _lines: dict[int, viser.GuiHtmlHandle] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.views.changed = self._say

    def build(self) -> None:
        """Add the buttons where the page builds now, and the keys."""
        views, say = self.views, self.page.words.of
        acts: dict[str, Callable[[viser.ClientHandle], None]] = {
            say("{Kind}"): views.to_hand,
            "In": lambda client: views.zoom_by(client, _STEP),
            "Out": lambda client: views.zoom_by(client, 1 / _STEP),
            "All": views.fit,
        }
        buttons = self.page.gui.add_button_group("Zoom", tuple(acts), hint=say(_HINT))
        self.page.own(buttons, lambda client, what: acts[what](client))
        for words, key, act in (
            ("View: the {kind}, and back into the camera", "C", say("{Kind}")),
            ("View: nearer", "Z", "In"),
            ("View: wider", "X", "Out"),
            ("View: the whole image", "V", "All"),
        ):
            self._key(words, key, acts[act])

    def _key(self, words: str, key: str, act: Callable[[viser.ClientHandle], None]) -> None:
        from_user = self.page.from_user(lambda event: act(event.client))
        self.page.everyones.add(self.keys.add(words, key, from_user))

    def _say(self, client: viser.ClientHandle, view: Through | None) -> None:
        line = self._lines.get(client.client_id)
        if view is None:
            self._lines.pop(client.client_id, None)
            if line is not None:
                line.remove()
            return
        here = self.page.server.get_clients()
        self._lines = {one: handle for one, handle in self._lines.items() if one in here}
        if line is None:
            line = self._lines[client.client_id] = client.gui.add_html("", order=0.5)
        put(line, content=self.page.words.of(view_words(view)))


def view_words(view: Through) -> str:
    """Return the line about a view."""
    name = html.escape(view.card.name)
    words, colour = f"<b>{name}</b>, {view.zoom.times:.1f} ×", "#56b4e9"
    if view.follows:
        words += ", follows the {kind}"
    if view.left:
        words, colour = f"<b>You left {name}:</b> C goes back", "#e69f00"
    return (
        f"<div style='margin:.3em .9em 0;padding:.15em .6em;border-left:3px solid {colour};font-size:.85em'>"
        f"{words}</div>"
    )
