"""One page edits at a time: the first that came. The others look on, and may take over.

What a page looks at is its own: the tabs, the view of the scene, the camera looked through and what is painted over its
image. What all see together, the frame and how the hand is drawn, is changed by the one that edits.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field

import viser

from handtrack_app import viser_internals as internals
from handtrack_app.page.page import Page

_AGAIN_S = 5.0
"""a page that looks on and is used is told at most so often"""


@dataclass
class Editing:
    """Who edits; `UserState.editor` names the client."""

    page: Page
    _buttons: dict[int, viser.GuiButtonHandle] = field(default_factory=dict)
    _told: dict[int, float] = field(default_factory=dict)
    _lock: threading.RLock = field(default_factory=threading.RLock)

    def may_edit(self, client_id: int) -> bool:
        """Return whether what a page sends counts."""
        return self._editor() in (None, client_id)

    def welcome(self, client: viser.ClientHandle) -> None:
        """Let the first page edit and a later one look on."""
        with self._lock:
            here = self.page.server.get_clients()
            if client.client_id not in here:  # left again; perhaps before it came, as threads go
                return
            self._buttons = {one: button for one, button in self._buttons.items() if one in here}
            self._told = {one: when for one, when in self._told.items() if one in here}
            if self._editor() is None:
                self.page.state.editor = client.client_id
                return
            self._look_on(client)
        self.page.notify(
            "info",
            "Another page edits",
            "You look on: the tabs, your view of the scene and the camera you look through are your own. Take over editing to "
            "change anything else.",
            client,
        )

    def leave(self, client: viser.ClientHandle) -> None:
        """Pass editing on when the page that edits goes."""
        with self._lock:
            self._buttons.pop(client.client_id, None)
            self._told.pop(client.client_id, None)
            if self.page.state.editor != client.client_id:
                return
            heir = next(iter(self.page.server.get_clients().values()), None)
            self.page.state.editor = None if heir is None else heir.client_id
            if heir is not None:
                self._edit(heir)
        if heir is not None:
            self.page.notify("info", "You edit now", "The page that edited was closed.", heir)

    def take_over(self, client: viser.ClientHandle) -> None:
        """Let a page edit in the place of the one that does."""
        with self._lock:
            editor = self._editor()
            before = None if editor is None else self.page.server.get_clients().get(editor)
            self.page.state.editor = client.client_id
            self._edit(client)
            if before is not None and before.client_id != client.client_id:
                self._look_on(before)
        if before is not None and before.client_id != client.client_id:
            self.page.notify("warning", "Another page took over", "You look on now.", before)

    def refuse(self, client_id: int, name: str) -> None:
        """Undo in a page that looks on what it did there, and tell it why. name: of the widget or node."""
        client = self.page.server.get_clients().get(client_id)
        if client is None:
            return
        widget = internals.widgets(self.page.server).get(name)
        node = internals.nodes(self.page.server).get(name)
        if widget is not None and not internals.is_button(widget):
            internals.show_value(client, widget, widget.value)
        if node is not None:
            internals.show_pose(
                client, name, tuple(node.position.tolist()), tuple(node.wxyz.tolist())
            )
        now = time.monotonic()
        if now - self._told.get(client_id, -_AGAIN_S) >= _AGAIN_S:
            self._told[client_id] = now
            self.page.notify(
                "info", "Another page edits", "Take over editing to change this.", client
            )

    def _editor(self) -> int | None:
        """Return the client that edits; None where it has gone, though nobody was told yet."""
        editor = self.page.state.editor
        return editor if editor in self.page.server.get_clients() else None

    def _look_on(self, client: viser.ClientHandle) -> None:
        button = client.gui.add_button(
            "Take over editing", icon=viser.Icon.PENCIL, color="orange", order=-1.0,
            hint="Another page edits; you look on.",
        )  # fmt: skip
        button.on_click(lambda _: self.take_over(client))
        self._buttons[client.client_id] = button

    def _edit(self, client: viser.ClientHandle) -> None:
        button = self._buttons.pop(client.client_id, None)
        if button is not None:
            button.remove()
