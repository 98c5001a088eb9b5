"""Keys: what the keyboard does, registered and listed in one place."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import viser

_MODIFIERS = {"cmd/ctrl": "Ctrl", "cmd/ctrl+shift": "Ctrl Shift", "shift": "Shift"}


@dataclass
class Keys:
    """Registers commands with their keys; the palette (Ctrl-K) has them too."""

    gui: viser.GuiApi
    known: list[tuple[str, str]] = field(default_factory=list)
    """key and what it does, in words"""

    def add(
        self, words: str, key: Any, action: Callable[[Any], None], modifier: Any = None
    ) -> None:
        """Let a key do something; `action` gets viser's event."""
        command: Any = self.gui.add_command(words, hotkey=key, modifier=modifier)
        command.on_trigger(action)
        self.known.append((f"{_MODIFIERS.get(modifier, '')} {key}".strip(), words))

    def table(self) -> str:
        """Return the list of keys for the page."""
        rows = "".join(
            f"<tr><td style='white-space:nowrap;padding-right:1em'><kbd>{html.escape(key)}</kbd></td>"
            f"<td style='opacity:.8'>{html.escape(words)}</td></tr>"
            for key, words in (*self.known, ("Ctrl K", "All commands, by name"))
        )
        return (
            "<div style='padding:.2em .9em 0;font-size:.8em;opacity:.8'>After a list or a number was used, click into the "
            "scene first.</div>"
            f"<table style='padding:.2em .9em .5em;font-size:.8em;line-height:1.6'>{rows}</table>"
        )
